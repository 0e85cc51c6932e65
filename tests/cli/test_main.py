"""What ends a command, and how it is told."""

import errno
import json
import sys
import types

import jax
import numpy as np
import pytest

from galton.cli import main as command
from galton.errors import BrokenEnvironmentError, CheckpointError, UsageError


@pytest.fixture
def end_with(monkeypatch, capsys):
    """A function that runs `galton train` with these words, where it ends with this error: code and stderr."""

    def run(error, *words):
        def fail(_):
            raise error

        module = types.ModuleType("galton.cli.train")
        module.main = fail
        monkeypatch.setitem(sys.modules, module.__name__, module)
        monkeypatch.setattr(sys, "argv", ["galton", "train", *words])
        monkeypatch.setattr(sys, "path", [*sys.path])
        with pytest.raises(SystemExit) as left:
            command.main()
        return left.value.code, capsys.readouterr().err

    return run


@pytest.mark.parametrize(
    ("error", "code", "told"),
    [
        (UsageError("eta is 0"), 2, "eta is 0"),
        (CheckpointError("it is damaged"), 2, "it is damaged"),
        (BrokenEnvironmentError("it broke"), 1, "it broke"),
        (SystemExit(130), 130, ""),
        (OSError(errno.ENOSPC, "No space left on device", "x"), 2, "a file can't be read or written: [Errno 28]"),
        (PermissionError(errno.EACCES, "Permission denied", "x"), 2, "a file can't be read or written: [Errno 13]"),
        (KeyboardInterrupt(), 130, "interrupted; nothing was written"),
    ],
)
def test_an_error_is_one_line_and_a_code(error, code, told, end_with):
    found, said = end_with(error, "bandit")
    assert found == code
    assert said.startswith(f"galton: {told}") if told else said == ""
    assert said.count("\n") <= 1


def no_memory_of_numpy():
    try:
        np.empty(2**50)
    except MemoryError as error:
        return error


NO_MEMORY = [
    MemoryError(),
    no_memory_of_numpy(),
    jax.errors.JaxRuntimeError("RESOURCE_EXHAUSTED: Out of memory allocating 99 bytes.\nand more\nof it"),
    RuntimeError("RESOURCE_EXHAUSTED: from a worker"),
]


@pytest.mark.parametrize("error", NO_MEMORY, ids=repr)
@pytest.mark.parametrize(
    ("words", "named"),
    [
        (["bandit", "--n-envs", "9"], "--n-envs smaller"),
        (["bandit", "--n_envs=9", "--eta", "1"], "--n-envs smaller"),
        (["bandit", "--seeds", "9", "--net-arch", "1", "2"], "--net-arch or --seeds smaller"),
        (["bandit"], "--net-arch or --n-bins or --n-envs"),
    ],
)
def test_too_little_memory_names_what_was_asked_for(error, words, named, end_with):
    code, said = end_with(error, *words)
    assert code == 2
    assert said.startswith("galton: there is too little memory for this; make")
    assert named in said
    assert said.count("\n") == 1


@pytest.mark.parametrize("error", [RuntimeError("a bug"), ZeroDivisionError(), json.JSONDecodeError("a", "b", 0)])
def test_a_bug_keeps_its_traceback(error, end_with):
    with pytest.raises(type(error)):
        end_with(error)
