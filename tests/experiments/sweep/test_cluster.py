"""Dask, for real: a scheduler and workers as processes on loopback."""

import contextlib
import os
import signal
import socket
import subprocess
import sys
import time

import pytest

from galton.errors import UsageError
from galton_experiments.commands.sweep import _workers
from galton_experiments.sweep import cluster, engine, results
from galton_experiments.sweep.grid import expand
from galton_experiments.sweep.plan import Plan
from galton_experiments.sweep.shard import finished
from galton_experiments.sweep.store import Store
from galton_experiments.sweep.study import Study

SETTING = {"loss": ["gaussian", "hl-one-hot"], "learning_rate": [0.01, 0.1], "n_steps": 5, "net_arch": (), "n_bins": 5}
STUDY = Study("bandit", expand([SETTING], {}), trials=6, steps=60_000, logs=2, eval_episodes=0)


def free_port():
    with socket.socket() as s:
        s.bind(("127.0.0.1", 0))
        return s.getsockname()[1]


@contextlib.contextmanager
def dask(n_workers, folder, *, protocol="tcp", options=()):
    """The address of a scheduler on loopback and the workers' processes; a worker that is silent is soon given up."""
    address = f"{protocol}://127.0.0.1:{free_port()}"
    environment = os.environ | {
        "DASK_DISTRIBUTED__SCHEDULER__WORKER_TTL": "4s",
        "JAX_COMPILATION_CACHE_DIR": str(folder / "programs"),
        "JAX_PERSISTENT_CACHE_MIN_COMPILE_TIME_SECS": "0.05",
    }
    with contextlib.ExitStack() as stack:

        def begin(*command):
            log = stack.enter_context((folder / f"{command[0]}-{time.monotonic_ns()}.log").open("w"))
            process = subprocess.Popen(
                [sys.executable, "-m", "distributed.cli." + command[0], *command[1:], *options],
                stdout=log, stderr=log, env=environment, cwd=folder,
            )  # fmt: skip
            stack.callback(process.wait)
            stack.callback(process.kill)
            stack.callback(process.send_signal, signal.SIGCONT)
            return process

        host, port = address.split("//")[1].split(":")
        begin(
            "dask_scheduler", "--host", f"{protocol}://{host}", "--port", port, "--no-dashboard", "--protocol", protocol
        )
        workers = [
            begin("dask_worker", address, "--nthreads", "1", "--no-nanny", "--no-dashboard", "--name", str(i))
            for i in range(n_workers)
        ]
        yield address, workers


@pytest.fixture(scope="module")
def reference(tmp_path_factory):
    store = Store(str(tmp_path_factory.mktemp("reference")))
    plan = Plan.create(STUDY, 2)
    plan.save(store)
    from galton_experiments.sweep.executors import Processes, one_per_core

    with Processes(one_per_core(2)) as executor:
        engine.run(store, plan, executor, lambda: 2)
    results.save(store, results.collect(store, plan))
    return store.read(results.FILE)


class Saboteur:
    """One worker killed and one stopped as soon as each has something to do."""

    def __init__(self, workers):
        self.workers, self.done = workers, 0

    def __call__(self, reports, before):
        self.done += len(reports)
        if self.done == 2 and not before:
            self.workers[0].send_signal(signal.SIGKILL)
            self.workers[1].send_signal(signal.SIGSTOP)


@pytest.mark.slow
def test_with_one_worker_killed_and_one_stopped_the_bytes_are_the_same(tmp_path, reference):
    store = Store(str(tmp_path / "out"))
    with dask(3, tmp_path) as (address, workers), cluster.connect(address) as (executor, width), store.lock():
        while width() < 3:
            time.sleep(0.1)
        plan = engine.prepare(store, STUDY, 2, extend=False)
        saboteur = Saboteur(workers)
        engine.run(store, plan, executor, width, saboteur, lost=cluster.LOST)
        assert saboteur.done == plan.n_shards == 12
        assert width() == 1
    results.save(store, results.collect(store, plan))
    assert store.read(results.FILE) == reference


BENCHMARK = """
budget = { settings = 2, seeds = 2, fresh_seeds = 3, steps = 100, logs = 2, eval_episodes = 1 }
prior = { learning_rate = { log-uniform = [0.01, 1] } }
methods.gaussian.fixed = { loss = "gaussian" }
methods.bins.fixed = { loss = "hl-one-hot", n_bins = 5 }
tasks.bandit = {}
tasks.noisy = { env = "bandit", env_kwargs = { noise_std = 5.0 }, held_out = true }
"""


@pytest.mark.slow
def test_a_benchmark_on_a_cluster_has_the_bytes_of_one_on_this_machine(tmp_path):
    (tmp_path / "mine.toml").write_text(BENCHMARK)
    command = [sys.executable, "-m", "galton", "benchmark", "mine.toml", "--out"]
    with dask(2, tmp_path) as (address, _):
        there = subprocess.run(
            [*command, "there", "--scheduler", address], cwd=tmp_path, capture_output=True, text=True
        )
    assert there.returncode == 0, there.stderr
    here = subprocess.run([*command, "here", "--workers", "1"], cwd=tmp_path, capture_output=True, text=True)
    assert here.returncode == 0, here.stderr
    names = [path.relative_to(tmp_path / "here") for path in (tmp_path / "here").glob("data/*")]
    assert len(names) == 3
    for name in (*names, "report.json", "index.html", "benchmark.json"):
        assert (tmp_path / "here" / name).read_bytes() == (tmp_path / "there" / name).read_bytes()


@pytest.mark.slow
def test_the_command_trains_on_a_cluster_with_tls(tmp_path):
    keys = tmp_path / "keys"
    keys.mkdir()
    make_keys(keys)
    options = ["--tls-ca-file", keys / "ca.pem", "--tls-cert", keys / "cert.pem", "--tls-key", keys / "key.pem"]
    grid = tmp_path / "grid.toml"
    grid.write_text('[[grid]]\nloss = "gaussian"\nlearning_rate = [0.01, 0.1]\nn_steps = 5\nnet_arch = []\n')
    sweep = [sys.executable, "-m", "galton", "sweep", "bandit", "--grid", grid, "--trials", "2", "--steps", "100"]
    sweep += ["--logs", "2", "--eval-episodes", "0", "--shard-width", "2", "--out", tmp_path / "out"]
    with dask(1, tmp_path, protocol="tls", options=tuple(map(str, options))) as (address, _):
        run = [*sweep, "--scheduler", address]
        plain = subprocess.run(run, capture_output=True, text=True, timeout=120)
        assert plain.returncode == 2
        assert "scheduler is" in plain.stderr
        secure = subprocess.run([*run, "--tls", keys], capture_output=True, text=True, timeout=120)
    assert secure.returncode == 0, secure.stderr
    assert "4 of 4 runs" in secure.stdout
    store = Store(str(tmp_path / "out"))
    assert len(finished(store, Plan.load(store))) == 2


def make_keys(folder):
    """A certificate that signs itself, for both ends."""
    command = "openssl req -x509 -newkey rsa:2048 -nodes -days 1 -subj /CN=127.0.0.1 -keyout key.pem -out cert.pem"
    subprocess.run(command.split(), cwd=folder, check=True, capture_output=True)
    (folder / "ca.pem").write_bytes((folder / "cert.pem").read_bytes())


def test_no_scheduler_and_missing_files_are_told(tmp_path, monkeypatch):
    monkeypatch.setattr(cluster, "PATIENCE", 1)
    with pytest.raises(UsageError, match="where none answers"), cluster.connect(f"tcp://127.0.0.1:{free_port()}"):
        pass
    with pytest.raises(UsageError, match=r"holds no ca\.pem"), cluster.connect("tls://127.0.0.1:1", tmp_path):
        pass


def test_a_scheduler_that_does_not_answer_leaves_no_plan(tmp_path, monkeypatch):
    """Which the next call, of another grid perhaps, would meet."""
    monkeypatch.setattr(cluster, "PATIENCE", 0.5)
    store = Store(str(tmp_path / "out"))
    workers = _workers.Workers(scheduler=f"tcp://127.0.0.1:{free_port()}")
    with pytest.raises(UsageError, match="where none answers"), workers.hired():
        engine.prepare(store, STUDY, None, extend=False)
    assert not (tmp_path / "out").exists()
