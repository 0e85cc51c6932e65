"""The command as a user meets it: separate processes, real files."""

import json
import os
import re
import signal
import subprocess
import sys
import sysconfig
import time
from pathlib import Path

import numpy as np
import pyarrow.parquet as pq
import pytest
from PIL import Image

from galton import LOSSES
from galton.saving.checkpoint import read

SMALL = ["--algorithm", "a2c", "--steps", "400", "--logs", "4", "--eval-episodes", "2", "--n-bins", "10"]


GALTON = Path(sysconfig.get_path("scripts"), "galton")


def galton(*arguments, cwd=None):
    return subprocess.run([GALTON, *map(str, arguments)], capture_output=True, text=True, cwd=cwd, timeout=300)


def test_help_names_the_commands_and_needs_no_jax():
    done = galton("--help")
    assert done.returncode == 0
    assert "train" in done.stdout
    assert "compare" in done.stdout
    check = "import sys; from galton.cli.main import main; sys.argv[1:] = ['--help']; main(); "
    check += "assert 'jax' not in sys.modules"
    assert subprocess.run([sys.executable, "-c", check], capture_output=True).returncode == 0


WRONG = [
    (["frobnicate"], "command is 'frobnicate'; choose from train, compare, sweep, benchmark, watch, export"),
    (["compare", "cartpole"], "environment is 'cartpole'; Gymnasium knows no environment of that name"),
    (["train", "lqr", "--loss", "mse"], "--loss is 'mse'; choose from gaussian"),
    (["compare", "lqr", "--losses", "gaussian", "mse"], "--losses is 'mse'; choose from gaussian"),
    (
        ["compare", "lqr", "--losses", "gaussian", "gaussian"],
        "--losses is ('gaussian', 'gaussian'); name each loss once",
    ),
    (["sweep", "lqr", "--grid", "papers"], "--grid is 'papers', which can't be read as TOML"),
    (["sweep", "lqr", "--shard-width", "0"], "--shard-width is 0; it must be an integer of at least 1"),
    (["sweep", "lqr", "--trials", "0"], "--trials is 0; it must be an integer of at least 1"),
    (["sweep", "lqr", "--workers", "0"], "--workers is 0; it must be an integer of at least 1"),
    (["sweep", "lqr", "--imports", "no_such_module"], "--imports names 'no_such_module', which can't be imported"),
    (["sweep", "lqr", "--tls", "keys"], "--tls is keys; it goes with a scheduler"),
    (["sweep", "lqr", "--n-settings", "4"], "--n-settings is 4; it goes with grid 'random'"),
    (["sweep", "lqr", "--scheduler", "tcp://h:1", "--workers", "2"], "--workers is 2; it goes with processes here"),
    (["sweep", "lqr", "--gpus", "1", "--workers", "2"], "--workers is 2; it goes with processes here"),
    (["sweep", "lqr", "--scheduler", "tcp://h:1", "--gpus", "1"], "--gpus is 1; it goes with processes here"),
    (["sweep", "lqr", "--out", "nonsense://x"], "--out is 'nonsense://x', which can't be opened"),
    (["benchmark", "none.toml"], "file is 'none.toml', which can't be read as TOML: [Errno 2] No such file or"),
    (["benchmark", "none.toml", "--shard-width", "0"], "--shard-width is 0; it must be an integer of at least 1"),
    (["benchmark", "none.toml", "--tls", "keys"], "--tls is keys; it goes with a scheduler"),
    (["benchmark"], "Missing from galton benchmark: FILE.toml The protocol"),
    (["sweep", "status", "nowhere"], "DIR is nowhere, which holds no sweep; start one with: galton sweep ENV"),
    (["train", "lqr", "--eta", "0"], "--eta is 0.0; it must be finite, and greater than 0"),
    (["compare", "lqr", "--eta", "-0.5"], "--eta is -0.5; it must be finite, and greater than 0"),
    (["train", "lqr", "--n-bins", "1"], "--n-bins is 1; it must be an integer of at least 2"),
    (["compare", "lqr", "--seeds", "0"], "--seeds is 0; it must be an integer of at least 1"),
    (["compare", "lqr", "--steps", "0"], "--steps is 0; it must be an integer of at least 1"),
    (["compare", "lqr", "--env-kwargs", "{"], "--env-kwargs is '{', which is not JSON"),
    (["compare", "lqr", "--env-kwargs", '{"noise_std": "x"}'], "lqr can't be made with {'noise_std': 'x'}"),
    (["compare", "lqr", "--env-kwargs", '{"mass": 1}'], "lqr has no constant 'mass'; it has A, B, Q, R"),
    (
        ["trian"],
        "command is 'trian'; choose from train, compare, sweep, benchmark, watch, export, check, evaluate, plot; "
        "did you mean train?",
    ),
    (["train", "bandit", "--logs", "0"], "--logs is 0; it must be an integer of at least 1"),
    (["train", "bandit", "--eval-episodes", "-1"], "--eval-episodes is -1; it must be an integer of at least 0"),
    (["train", "bandit", "--save-every", "0"], "--save-every is 0; it must be at least 1"),
    (["train", "bandit", "--learning-rate", "-1"], "--learning-rate is -1.0; it must be"),
    (["train", "bandit", "--steps", "1e13"], "--steps is 10000000000000; a run counts up to 2³¹ − 1 updates"),
    (["train", "bandit", "--steps", "1.5"], "--steps: '1.5' is no integer; write it like 100000, 100_000 or 1e5"),
    (["sweep", "bandit", "--workers", "two"], "--workers: 'two' is no integer"),
    (["train", "bandit", "--lr", "1"], "--lr is no option of `galton train`; did you mean --learning-rate?"),
    (
        ["train", "bandit", "--total-timesteps", "9"],
        "--total-timesteps is no option of `galton train`; did you mean",
    ),
    (["train", "--env", "Pendulum-v1"], "--env is no option of `galton train`; its value has a place of its own"),
    (["train", "--env-id", "Pendulum-v1", "--lr", "1"], "--env-id is no option of `galton train`"),
    (["train", "bandit", "--normalize-reward", "false"], "'false' is one argument too many; a switch stands alone"),
    (["train", "bandit", "--net-arch", "64,64"], "--net-arch: '64,64' is no integer"),
    (["sweep", "lqr", "--grid", "papr"], "--grid is 'papr', which can't be read as TOML: [Errno 2] No such file or"),
    (["sweep", "status"], "Missing from galton sweep status: DIR Its folder"),
    (["train", "bandit", "lqr"], "'lqr' is one argument too many; `galton train --help-all` lists the options"),
    (["compare"], "Missing from galton compare: ENV one of bandit, lqr"),
    (["train", "bandit", "--ratio", "x"], "invalid choice 'x' for argument '--ratio'"),
    (["train", "mountaincar"], "environment is 'mountaincar'; Gymnasium knows no environment of that name"),
    (
        ["train", "lqr", "--loss", "hlgauss"],
        "--loss is 'hlgauss'; choose from gaussian, hl-one-hot, hl-gauss",
    ),
    (
        ["train", "lqr", "--algorithm", "A2C"],
        "--algorithm is 'A2C'; choose from a2c, ppo, trpo, v-mpo; did you mean a2c?",
    ),
    (["reproduce", "figure-3"], "reproduce is a command of a clone now: python -m studies.paper reproduce"),
    (["train", "Pendulum"], "environment is 'Pendulum', an id without its version; 'Pendulum-v1' is the newest"),
    (["export", "nowhere"], "run is nowhere, which does not exist"),
    (["export", "."], "run is ., which holds no model.safetensors; name a run folder of `galton train`, or a"),
    (["export", "nowhere", "--format", "torch"], "--format is 'torch'; choose from onnx, card"),
    (["watch", "nowhere", "--seed", "-1"], "--seed is -1; it must be an integer of at least 0"),
    (["watch", "nowhere", "--seed", "4294967295", "--episodes", "2"], "--seed is 4294967296; it must be less than 2³²"),
]

MANY = """
import contextlib, io, json, sys
from galton.cli.main import main
for sys.argv in json.load(sys.stdin):
    said, code = io.StringIO(), None
    with contextlib.redirect_stderr(said):
        try:
            main()
        except SystemExit as left:
            code = left.code
    print(json.dumps([code, said.getvalue()]))
"""


@pytest.fixture(scope="module")
def complaints(tmp_path_factory):
    """Exit code and words for each of WRONG, from one process, and what they left in its folder."""
    folder = tmp_path_factory.mktemp("wrong")
    asked = json.dumps([["galton", *arguments] for arguments, _ in WRONG])
    done = subprocess.run([sys.executable, "-c", MANY], input=asked, capture_output=True, text=True, cwd=folder)
    assert done.returncode == 0, done.stderr
    return [json.loads(line) for line in done.stdout.splitlines()], list(folder.iterdir())


@pytest.mark.slow
@pytest.mark.parametrize("index", range(len(WRONG)), ids=[" ".join(arguments) for arguments, _ in WRONG])
def test_a_wrong_argument_gives_one_clear_line_and_code_2(index, complaints, trust):
    said, left = complaints
    code, words = said[index]
    assert code == 2
    assert words.startswith(f"galton: {WRONG[index][1]}")
    assert words.count("\n") == 1
    assert left == [], "nothing is written"
    promise = "A wrong command ends with one line that names the option, its value and what would be right."
    trust("wrong-commands", promise, topic="damage", figure=1, unit="commands", at_least=len(WRONG), over="sum")


@pytest.mark.slow
def test_gymnasium_ids_are_taken_and_what_they_cant_do_is_said(tmp_path):
    done = galton("train", "CartPole-v1", *SMALL, "--out", tmp_path / "choices", cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    out = tmp_path / "run"
    done = galton("train", "Pendulum-v1", *SMALL, "--env-kwargs", '{"g": 5.0}', "--out", out, cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    film = tmp_path / "film.gif"
    done = galton("watch", out, "--out", film, "--max-steps", "10")
    assert done.returncode == 0, done.stderr
    with Image.open(film) as frames:
        assert frames.n_frames == 11
        frames.seek(5)
        assert np.ptp(np.asarray(frames.convert("L"))) > 0
    done = galton("compare", "Pendulum-v1", "--seeds", "2", *SMALL, "--losses", "gaussian", "--out", tmp_path / "cmp")
    assert done.returncode == 0, done.stderr
    assert json.loads((tmp_path / "cmp" / "summary.json").read_text())[0]["rest_to_optimum"] is None


@pytest.mark.slow
def test_an_id_may_name_the_module_that_registers_it(tmp_path):
    (tmp_path / "mine.py").write_text(
        "import gymnasium\ngymnasium.register('Mine-v0', 'gymnasium.envs.classic_control:PendulumEnv', "
        "max_episode_steps=20)\n"
    )
    done = galton("train", "mine:Mine-v0", *SMALL, "--out", "run", cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    done = galton("watch", "run", cwd=tmp_path)
    assert done.returncode == 2
    assert "which imports a module; give it with --env if you trust it" in done.stderr
    done = galton("watch", "run", "--env", "mine:Mine-v0", "--out", "a.gif", cwd=tmp_path)
    assert done.returncode == 0, done.stderr


@pytest.mark.slow
def test_an_interrupted_run_is_saved_and_goes_on(tmp_path):
    out = tmp_path / "run"
    command = [GALTON, "train", "lqr", "--eval-episodes", "0", "--logs", "10000", "--out", out]
    process = subprocess.Popen([*command, "--steps", "100000000"], stderr=subprocess.PIPE, stdout=subprocess.DEVNULL)
    deadline = time.monotonic() + 120
    while not (out / "metrics.jsonl").exists() and time.monotonic() < deadline:
        time.sleep(0.1)
    process.send_signal(signal.SIGINT)
    _, stderr = process.communicate(timeout=120)
    assert process.returncode == 130
    step = int(re.search(r"interrupted at step ([\d,]+)", stderr.decode())[1].replace(",", ""))
    assert read(out / "model.safetensors")[0]["step"] == step > 0


@pytest.mark.slow
@pytest.mark.parametrize("command", ["train", "compare"])
def test_a_folder_in_use_is_refused_and_left_alone(command, tmp_path):
    (tmp_path / "out").mkdir()
    (tmp_path / "out" / "precious").write_text("mine")
    done = galton(command, "lqr", *SMALL, "--out", tmp_path / "out")
    assert done.returncode == 2
    assert "which is there already; name another folder or give --overwrite" in done.stderr
    assert done.stderr.count("\n") == 1
    assert [path.name for path in tmp_path.rglob("*")] == ["out", "precious"]


@pytest.mark.slow
@pytest.mark.parametrize("options", [["train", "lqr", "--steps", "100000000"], ["compare", "lqr"]], ids=lambda x: x[0])
def test_two_processes_do_not_fill_one_folder(options, tmp_path):
    command = [GALTON, *options, "--n-bins", "10", "--out", tmp_path / "run"]
    first = subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    deadline = time.monotonic() + 60
    while not (tmp_path / ".run.lock").exists() and time.monotonic() < deadline:
        time.sleep(0.1)
    second = galton(*command[1:], "--overwrite")
    first.kill()
    first.wait(60)
    assert second.returncode == 2
    assert "which another process is filling" in second.stderr


def test_train_writes_a_run_folder(tmp_path):
    done = galton("train", "bandit", "--loss", "hl-one-hot", "--seed", "7", *SMALL, "--out", tmp_path / "run")
    assert done.returncode == 0, done.stderr
    files = {path.name for path in (tmp_path / "run").iterdir()}
    assert files == {"config.json", "metrics.jsonl", "model.safetensors", "best_model.safetensors"}
    assert list(tmp_path.iterdir()) == [tmp_path / "run"], "no scratch and no lock is left"
    settings = json.loads((tmp_path / "run" / "config.json").read_text())
    assert settings["loss"] == "hl-one-hot"
    assert settings["config"]["n_bins"] == 10
    assert "jax" in settings["versions"]
    lines = [json.loads(line) for line in (tmp_path / "run" / "metrics.jsonl").read_text().splitlines()]
    assert [line["time/total_timesteps"] for line in lines] == [100, 200, 300, 400]
    checkpoint, _ = read(tmp_path / "run" / "model.safetensors")
    assert (checkpoint["seed"], checkpoint["step"]) == (7, 400)


@pytest.mark.slow
def test_compare_writes_table_figure_and_numbers(tmp_path):
    out = tmp_path / "deep" / "cmp"
    done = galton("compare", "bandit", "--seeds", "3", "--steps", "200", "--logs", "4", "--out", out)
    assert done.returncode == 0, done.stderr
    files = {path.name for path in out.iterdir()}
    assert files == {"config.json", "summary.json", "curves.parquet", "learning_curves.png", "learning_curves.svg"}
    rows = json.loads((out / "summary.json").read_text())
    assert [row["loss"] for row in rows] == ["gaussian", "hl-one-hot", "hl-gauss"]
    assert all(row["loss"] in done.stdout or LOSSES[row["loss"]].label in done.stdout for row in rows)
    assert pq.read_table(out / "curves.parquet").num_rows == 3 * 3 * 4
    settings = json.loads((out / "config.json").read_text())
    assert settings["config"]["n_steps"] == 5, "the bandit's own defaults"
    again = galton(
        "compare", "bandit", "--seeds", "3", "--losses", "gaussian", "--steps", "200", "--out", out, "--overwrite"
    )
    assert again.returncode == 0
    assert list(out.parent.iterdir()) == [out]


@pytest.mark.slow
@pytest.mark.parametrize(
    ("number", "delay"),
    [(signal.SIGINT, 0.5), (signal.SIGINT, 3), (signal.SIGINT, 10), (signal.SIGTERM, 2)],
)
def test_an_interrupt_leaves_nothing_half_written(number, delay, tmp_path):
    """While it compiles, and while it trains."""
    out = tmp_path / "out"
    out.mkdir()
    mine = json.dumps({"versions": {}, "text": "mine"})
    (out / "config.json").write_text(mine)
    process = subprocess.Popen(
        [GALTON, "compare", "lqr", "--out", out, "--overwrite"],
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
    assert (out / "config.json").read_text() == mine


@pytest.mark.few
@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["-v"], "0."),
        (["version"], "0."),
        (["help"], "usage: galton COMMAND"),
        (["help", "plot"], "usage: galton plot"),
    ],
)
def test_version_and_help_may_be_asked_for_as_elsewhere(words, said):
    done = galton(*words)
    assert done.returncode == 0
    assert done.stdout.startswith(said)
