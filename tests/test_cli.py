"""The command as a user meets it: separate processes, real files."""

import json
import os
import re
import signal
import subprocess
import sys
import time

import pyarrow.parquet as pq
import pytest

from galton import LOSSES
from galton.envs import ENVS
from galton.training.checkpoint import load

SMALL = ["--steps", "400", "--logs", "4", "--eval-episodes", "2", "--n-bins", "10"]


def galton(*arguments, cwd=None):
    return subprocess.run(
        [sys.executable, "-m", "galton", *map(str, arguments)], capture_output=True, text=True, cwd=cwd, timeout=300
    )


def test_help_names_the_commands_and_needs_no_jax():
    done = galton("--help")
    assert done.returncode == 0
    assert "train" in done.stdout
    assert "compare" in done.stdout
    check = (
        "import sys; from galton.cli import main; sys.argv[1:] = ['--help']; main(); assert 'jax' not in sys.modules"
    )
    assert subprocess.run([sys.executable, "-c", check], capture_output=True).returncode == 0


@pytest.mark.parametrize("command", ["train", "compare"])
def test_a_commands_help_lists_losses_and_environments(command):
    done = galton(command, "--help")
    assert done.returncode == 0
    words = set(re.findall(r"[\w-]+", done.stdout))
    assert set(LOSSES) | set(ENVS) <= words


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["frobnicate"], "command is 'frobnicate'; choose from train, compare"),
        (["compare", "cartpole"], "environment is 'cartpole'; choose from bandit, lqr"),
        (["train", "lqr", "--loss", "mse"], "loss is 'mse'; choose from gaussian"),
        (["compare", "lqr", "--losses", "gaussian", "mse"], "loss is 'mse'; choose from gaussian"),
        (
            ["compare", "lqr", "--losses", "gaussian", "gaussian"],
            "losses is ('gaussian', 'gaussian'); name each loss once",
        ),
        (["train", "lqr", "--eta", "0"], "eta is 0.0; it must be greater than 0"),
        (["compare", "lqr", "--eta", "-0.5"], "eta is -0.5; it must be greater than 0"),
        (["train", "lqr", "--n-bins", "1"], "n_bins is 1; it must be an integer of at least 2"),
        (["compare", "lqr", "--seeds", "0"], "seeds is 0; it must be an integer of at least 1"),
        (["compare", "lqr", "--steps", "0"], "total_timesteps is 0"),
        (["compare", "lqr", "--env-kwargs", "{"], "env_kwargs is '{', which is not JSON"),
        (["compare", "lqr", "--env-kwargs", '{"noise_std": "x"}'], "lqr can't be made with {'noise_std': 'x'}"),
        (["compare", "lqr", "--env-kwargs", '{"mass": 1}'], "lqr has no constant 'mass'; it has A, B, Q, R"),
    ],
)
def test_a_wrong_argument_gives_one_clear_line_and_code_2(arguments, message, tmp_path):
    done = galton(*arguments, cwd=tmp_path)
    assert done.returncode == 2
    assert done.stderr.startswith(f"galton: {message}")
    assert done.stderr.count("\n") == 1
    assert list(tmp_path.iterdir()) == [], "nothing is written"


@pytest.mark.parametrize("command", ["train", "compare"])
def test_a_folder_in_use_is_refused_and_left_alone(command, tmp_path):
    (tmp_path / "out").mkdir()
    (tmp_path / "out" / "precious").write_text("mine")
    done = galton(command, "lqr", *SMALL, "--out", tmp_path / "out")
    assert done.returncode == 2
    assert "which is in use; name another folder or give --overwrite" in done.stderr
    assert done.stderr.count("\n") == 1
    assert [path.name for path in tmp_path.rglob("*")] == ["out", "precious"]


def test_train_writes_a_run_folder(tmp_path):
    done = galton("train", "lqr", "--loss", "hl-one-hot", "--seed", "7", *SMALL, "--out", tmp_path / "run")
    assert done.returncode == 0, done.stderr
    files = {path.name for path in (tmp_path / "run").iterdir()}
    assert files == {"config.json", "metrics.parquet", "checkpoint.json", "checkpoint.safetensors"}
    assert list(tmp_path.iterdir()) == [tmp_path / "run"], "no scratch and no lock is left"
    settings = json.loads((tmp_path / "run" / "config.json").read_text())
    assert settings["loss"] == "hl-one-hot"
    assert settings["config"]["n_bins"] == 10
    assert "jax" in settings["versions"]
    metrics = pq.read_table(tmp_path / "run" / "metrics.parquet").to_pydict()
    assert metrics["step"] == [100, 200, 300, 400]
    checkpoint = load(tmp_path / "run")
    assert (checkpoint.seed, checkpoint.step) == (7, 400)


def test_compare_writes_table_figure_and_numbers(tmp_path):
    out = tmp_path / "deep" / "cmp"
    done = galton("compare", "bandit", "--seeds", "3", "--steps", "200", "--logs", "4", "--out", out)
    assert done.returncode == 0, done.stderr
    files = {path.name for path in out.iterdir()}
    assert files == {"config.json", "summary.json", "curves.parquet", "learning_curves.png", "learning_curves.svg"}
    rows = json.loads((out / "summary.json").read_text())
    assert [row["loss"] for row in rows] == [name for name, loss in LOSSES.items() if loss.in_paper]
    assert all(row["loss"] in done.stdout or LOSSES[row["loss"]].label in done.stdout for row in rows)
    assert pq.read_table(out / "curves.parquet").num_rows == 3 * 3 * 4
    settings = json.loads((out / "config.json").read_text())
    assert settings["config"]["n_steps"] == 5, "the bandit's own defaults"
    again = galton("compare", "bandit", "--seeds", "3", "--steps", "200", "--logs", "4", "--out", out, "--overwrite")
    assert again.returncode == 0
    assert list(out.parent.iterdir()) == [out]


@pytest.mark.parametrize(
    ("number", "delay"), [(signal.SIGINT, 0.5), (signal.SIGINT, 3), (signal.SIGINT, 10), (signal.SIGTERM, 2)]
)
def test_an_interrupt_leaves_nothing_half_written(number, delay, tmp_path):
    """While it compiles, and while it trains."""
    out = tmp_path / "out"
    out.mkdir()
    (out / "config.json").write_text("mine")
    process = subprocess.Popen(
        [sys.executable, "-m", "galton", "compare", "lqr", "--out", out, "--overwrite"],
        stderr=subprocess.PIPE,
        stdout=subprocess.PIPE,
        text=True,
        env=os.environ | {"COLUMNS": "80"},
    )
    deadline = time.monotonic() + 60
    while len(list(tmp_path.iterdir())) == 1 and time.monotonic() < deadline:
        time.sleep(0.1)
    time.sleep(delay)
    process.send_signal(number)
    _, stderr = process.communicate(timeout=60)
    assert process.returncode == 130
    assert stderr.splitlines()[-1] == "galton: interrupted; nothing was written"
    assert "Traceback" not in stderr
    assert [path.name for path in tmp_path.rglob("*")] == ["out", "config.json"]
    assert (out / "config.json").read_text() == "mine"


def test_two_processes_do_not_fill_one_folder(tmp_path):
    first = subprocess.Popen(
        [sys.executable, "-m", "galton", "compare", "lqr", "--out", tmp_path / "out"], stdout=subprocess.DEVNULL
    )
    deadline = time.monotonic() + 60
    while not list(tmp_path.glob(".out.lock")) and time.monotonic() < deadline:
        time.sleep(0.1)
    second = galton("compare", "lqr", "--out", tmp_path / "out")
    first.send_signal(signal.SIGINT)
    first.wait(60)
    assert second.returncode == 2
    assert "which another process is filling" in second.stderr
    assert list(tmp_path.iterdir()) == []
