"""The command, killed: what is done stays done, and the end is the same to the byte."""

import os
import random
import shutil
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from galton.devices import allowed_cores
from galton.saving.files import SCRATCH
from galton_experiments.sweep import results
from galton_experiments.sweep.plan import Plan
from galton_experiments.sweep.shard import FOLDER as SHARDS
from galton_experiments.sweep.shard import finished
from galton_experiments.sweep.store import Store
from tests.trust import FOLDER

GRID = """
[[grid]]
loss = ["gaussian", "hl-one-hot"]
learning_rate = [0.01, 0.1]
n_steps = 5
net_arch = []
n_bins = 5
"""


@pytest.fixture(scope="module")
def programs(tmp_path_factory):
    """A cache of compiled programs that killed processes may damage."""
    return tmp_path_factory.mktemp("programs")


@pytest.fixture(scope="module")
def grid(tmp_path_factory):
    path = tmp_path_factory.mktemp("grid") / "grid.toml"
    path.write_text(GRID)
    return path


def keeping(programs):
    """The environment of a command that keeps its compiled programs there."""
    kept = {"JAX_COMPILATION_CACHE_DIR": str(programs), "JAX_PERSISTENT_CACHE_MIN_COMPILE_TIME_SECS": "0.05"}
    return os.environ | kept


def start(out, grid, programs, *more):
    options = ["--grid", grid, "--trials", 4, "--shard-width", 2, "--steps", 4000, "--logs", 4, "--eval-episodes", 0]
    command = [sys.executable, "-m", "galton", "sweep", "bandit", *options, "--out", out, *more]
    return subprocess.Popen(
        list(map(str, command)),
        env=keeping(programs),
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        start_new_session=True,
    )


def finish(out, grid, programs, *more):
    output, errors = (process := start(out, grid, programs, *more)).communicate(timeout=300)
    assert process.returncode == 0, errors
    return output


@pytest.fixture(scope="module")
def reference(tmp_path_factory, grid, programs):
    out = tmp_path_factory.mktemp("reference")
    finish(out, grid, programs)
    return (out / results.FILE).read_bytes()


def n_done(out):
    store = Store(str(out))
    return len(finished(store, Plan.load(store)))


def kill_once(out, grid, programs, seed):
    """SIGKILL to the whole group at a random time, before the last of the 8 shards; how many were done then."""
    process, draw = start(out, grid, programs), random.Random(seed)
    target = draw.randrange(7)
    while target and not ((out / "plan.parquet").exists() and n_done(out) >= target):
        assert process.poll() is None, process.communicate()
        time.sleep(0.01)
    time.sleep(draw.uniform(0, 0.1 if target else 4.0))
    os.killpg(process.pid, signal.SIGKILL)
    process.communicate()
    return n_done(out) if (out / "plan.parquet").exists() else 0


KILLS = 50 if FOLDER else 6
"""How often the promise is tried by `make trust`, and by `make test-all`."""


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(KILLS))
def test_killed_at_any_time_it_goes_on_to_the_same_bytes(tmp_path, grid, programs, reference, seed, trust):
    while kill_once(tmp_path / "out", grid, programs, seed) == 8:  # too late: the last shard was done
        shutil.rmtree(tmp_path / "out")
    finish(tmp_path / "out", grid, programs)
    assert (tmp_path / "out" / results.FILE).read_bytes() == reference
    assert not list((tmp_path / "out").glob(f"**/{SCRATCH}*"))
    promise = "A sweep that is killed at any time goes on with the same command and ends with the same bytes."
    trust("sweep-killed", promise, topic="work", figure=1, unit="kills survived", at_least=50, over="sum")


@pytest.mark.slow
@pytest.mark.parametrize("workers", [1, 4])
def test_the_number_of_workers_does_not_change_a_byte(tmp_path, grid, programs, reference, workers):
    finish(tmp_path / "out", grid, programs, "--workers", workers)
    assert (tmp_path / "out" / results.FILE).read_bytes() == reference


def children(process_id):
    """The processes that this one started and that live."""
    lists = Path(f"/proc/{process_id}/task").glob("*/children")  # one of each thread
    return [int(number) for path in lists for number in path.read_text().split()]


LONGER = ("--steps", 200_000, "--trials", 8)
"""Many shards, each short enough for a worker that lives seconds."""


@pytest.mark.slow
def test_with_a_worker_killed_every_two_seconds_it_still_ends(tmp_path, grid, programs, reference, trust):
    process = start(tmp_path / "out", grid, programs, *LONGER)
    killed, n_before, draw = 0, -1, random.Random(0)
    while process.poll() is None:
        time.sleep(2)
        workers = [child for child in children(process.pid) if is_worker(child)]
        n_now = n_done(tmp_path / "out") if (tmp_path / "out" / SHARDS).exists() else 0
        if workers and n_now > n_before:  # on a busy machine none may get far in two seconds
            os.kill(draw.choice(workers), signal.SIGKILL)
            killed, n_before = killed + 1, n_now
    _, errors = process.communicate()
    assert process.returncode == 0, errors
    assert killed > 3
    finish(tmp_path / "whole", grid, programs, *LONGER)
    assert (tmp_path / "out" / results.FILE).read_bytes() == (tmp_path / "whole" / results.FILE).read_bytes()
    promise = "A sweep whose workers are killed again and again ends by itself, with the same bytes."
    trust("workers-killed", promise, topic="work", figure=killed, unit="workers killed", at_least=4)


def is_worker(process_id):
    try:
        return "spawn_main" in Path(f"/proc/{process_id}/cmdline").read_text()
    except (FileNotFoundError, ProcessLookupError):
        return False


@pytest.mark.slow
@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_an_interrupt_is_clean_and_says_how_to_go_on(tmp_path, grid, programs, reference, number):
    out = tmp_path / "out"
    process = start(out, grid, programs)
    while not (out / SHARDS).exists() or n_done(out) < 1:
        time.sleep(0.05)
    workers = [child for child in children(process.pid) if is_worker(child)]
    assert len(workers) == len(allowed_cores())
    os.killpg(process.pid, number) if number == signal.SIGINT else process.send_signal(number)
    _, errors = process.communicate(timeout=30)
    assert process.returncode == 130
    assert "of 8 shards are done, and the same command goes on with the rest" in errors
    assert "Traceback" not in errors
    assert not any(is_worker(worker) for worker in workers)
    assert not list(out.glob(f"**/{SCRATCH}*"))
    finish(out, grid, programs)
    assert (out / results.FILE).read_bytes() == reference


@pytest.mark.slow
def test_status_shard_results_and_rerun(tmp_path, grid, programs, reference):
    out = tmp_path / "out"
    assert "16 runs in 8 shards" in finish(out, grid, programs, "--plan-only")

    def galton(*arguments):
        command = [sys.executable, "-m", "galton", "sweep", *map(str, arguments)]
        return subprocess.run(command, capture_output=True, text=True, timeout=300, env=keeping(programs))

    assert "shard 3: 2 runs" in galton("shard", out, 3).stdout
    assert "shard 3 is done already" in galton("shard", out, 3).stdout
    assert "1 of 8 shards, 2 of 16 runs" in galton("status", out).stdout
    assert "2 of 16 runs: " in galton("results", out).stdout
    assert "14 runs are missing; run the sweep to its end first" in galton("rerun", out, "--to", out / "again").stderr
    (file,) = (out / SHARDS).iterdir()
    file.write_bytes(file.read_bytes()[:-1])
    assert "shard 3: 2 runs" in galton("shard", out, 3).stdout
    wrong = galton("shard", out, 8)
    assert (wrong.returncode, "shard is 8; the plan has 8, from 0 to 7" in wrong.stderr) == (2, True)
    finish(out, grid, programs)
    assert (out / results.FILE).read_bytes() == reference
    (out / results.FILE).unlink()
    assert "HL-1-Hot" in galton("results", out).stdout
    assert (out / results.FILE).read_bytes() == reference
    again = galton("rerun", out, "--to", tmp_path / "again", "--trials", 3)
    assert again.returncode == 0, again.stderr
    assert "6 of 6 runs" in again.stdout
    nothing = galton("status", tmp_path)
    assert (nothing.returncode, "holds no sweep" in nothing.stderr) == (2, True)
