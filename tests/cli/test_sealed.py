"""No command that works on this machine alone opens a port, unpickles a file or asks a shell."""

import json
import os
import platform
import signal
import subprocess
import sys
from pathlib import Path

import pytest

HERE = Path(__file__).parent
A2C = ["--algorithm", "a2c"]
SMALL = ["--steps", "100", "--logs", "2", "--eval-episodes", "1"]
GRID = '[[grid]]\nloss = "gaussian"\nlearning_rate = [0.05, 0.1]\n'
OWN_PIPES = ("multiprocessing.connection", "multiprocessing.spawn")
"""The modules by which a process of ours sends a call to another: both ends are ours, and no file is between them."""

pytestmark = pytest.mark.skipif(
    sys.platform != "linux" or platform.machine() not in ("x86_64", "aarch64"), reason="Linux filters what is called"
)


def sealed(folder, *command):
    """A finished process in a sealed environment, and what it and those it started did, as sitecustomize notes it."""
    log = folder / "log"
    log.unlink(missing_ok=True)
    paths = [str(HERE / "sealed"), *filter(None, [os.environ.get("PYTHONPATH")])]
    environment = os.environ | {"GALTON_SEALED": str(log), "PYTHONPATH": os.pathsep.join(paths)}
    done = subprocess.run(command, cwd=folder, env=environment, capture_output=True, text=True, timeout=600)
    return done, [json.loads(line) for line in log.read_text().splitlines()]


def check(folder, *command):
    """Run a command; how much was unpickled from pipes, once all else is found to be harmless."""
    done, events = sealed(folder, sys.executable, *command)
    assert done.returncode == 0, done.stderr
    for event, arguments, modules in events:
        if event == "pickle.find_class":
            assert {*OWN_PIPES} & {*modules}, f"unpickled {arguments} by way of {modules}"
        elif event == "subprocess.Popen":
            program, words = arguments[0], arguments[1]
            assert Path(program).name in ("git", "uname", Path(sys.executable).name), arguments
            assert "-c" not in words or "multiprocessing" in words, arguments
        else:
            raise AssertionError(f"{event} {arguments} by way of {modules}")
    return sum(event == "pickle.find_class" for event, _, _ in events)


WORKER = """
from galton_experiments.sweep.executors import one_per_core, processes
if __name__ == "__main__":
    with processes(one_per_core(1)) as executor:
        assert executor.submit(divmod, 7, 4).result() == (1, 3)
"""


def test_workers_are_sent_their_calls_through_a_pipe_and_nothing_else(tmp_path):
    (tmp_path / "worker.py").write_text(WORKER)
    assert check(tmp_path, "worker.py") > 0


@pytest.mark.slow
def test_no_local_command_does(tmp_path, trust):
    pytest.importorskip("onnx")
    (tmp_path / "grid.toml").write_text(GRID)
    commands = [
        ["train", "bandit", *A2C, *SMALL, "--out", "run", "--tensorboard"],
        ["train", "bandit", "--algorithm", "ppo", "--loss", "gaussian", *SMALL, "--out", "ppo"],
        ["train", "Pendulum-v1", *A2C, *SMALL, "--out", "pendulum"],
        ["train", "bandit", *A2C, "--steps", "200", *SMALL[2:], "--out", "run", "--tensorboard", "--resume"],
        ["compare", "bandit", *SMALL, "--seeds", "2", "--losses", "gaussian", "hl-gauss", "--out", "compare"],
        ["sweep", "bandit", "--grid", "grid.toml", "--trials", "1", *SMALL, "--workers", "2", "--out", "out"],
        ["sweep", "status", "out"],
        ["sweep", "results", "out"],
        ["sweep", "rerun", "out", "--to", "again", "--trials", "1", "--seed", "1", "--workers", "1"],
        ["watch", "pendulum", "--out", "film.gif", "--max-steps", "20"],
        ["export", "run", "--format", "onnx", "card"],
    ]
    for words in commands:
        unpickled = check(tmp_path, "-m", "galton", *words)
        assert not unpickled or words[0] == "sweep", words
    trust(
        "sockets",
        "No local command opens a port, unpickles a file or asks a shell, nor does a process that it starts.",
        topic="damage",
        figure=len(commands),
        unit="commands under a kernel's filter, 0 sockets bound",
        at_least=10,
    )


LISTENING = """
import socket, sys
one = socket.socket(socket.{family})
print("made", flush=True)
one.{call}
print("done", flush=True)
"""


@pytest.mark.parametrize(("family", "call"), [("AF_INET", "bind(('127.0.0.1', 0))"), ("AF_UNIX", "listen(1)")])
def test_a_process_that_listens_is_ended_by_the_kernel(family, call, tmp_path):
    code = LISTENING.format(family=family, call=call)
    done, _ = sealed(tmp_path, sys.executable, "-c", code)
    assert (done.returncode, done.stdout) == (-signal.SIGSYS, "made\n")
    child = f"import subprocess, sys; sys.exit(subprocess.run([sys.executable, '-c', {code!r}]).returncode != -31)"
    assert sealed(tmp_path, sys.executable, "-c", child)[0].returncode == 0


def test_what_is_unpickled_started_or_reached_is_noted_in_children_too(tmp_path):
    code = "import os, pickle, collections; pickle.loads(pickle.dumps(collections.OrderedDict())); os.system('true')"
    child = f"import subprocess, sys; subprocess.run([sys.executable, '-c', {code!r}], check=True)"
    for script, wanted in (
        (code, ["pickle.find_class", "os.system"]),
        (child, ["subprocess.Popen", "pickle.find_class"]),
    ):
        events = [event for event, _, _ in sealed(tmp_path, sys.executable, "-c", script)[1]]
        assert events[: len(wanted)] == wanted
