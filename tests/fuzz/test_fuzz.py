"""Readers of files give a value or an error of Galton's, whatever a file holds; `make fuzz` looks for longer."""

import importlib.util
import pickle
import random
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from galton_experiments.sweep import grid
from tests.trust import FOLDER

from . import guard, targets
from .__main__ import fuzz
from .targets import TARGETS

N_INPUTS = 100
"""Of each target, beside valid files and what was found before."""
SECONDS = 120 if FOLDER else 10
"""For each target: what `make trust` measures, and what a test takes."""


@pytest.mark.parametrize("name", TARGETS)
def test_valid_files_are_read_and_what_was_found_once_is_mended(name, tmp_path):
    targets.warm_up(name, tmp_path)
    found = {path.read_bytes() for path in (targets.HERE / "corpus" / name).glob("*")}
    taken = [data for data in targets.seeds(name) if targets.run(name, data, tmp_path)]
    assert set(targets.seeds(name)) - set(taken) <= found
    assert len(taken) >= 1


@pytest.mark.slow
def test_files_with_something_changed_are_read_or_refused():
    """In a process of its own, for here types are checked before a reader sees a value."""
    command = [sys.executable, "-W", "error", "-m", "tests.fuzz", "--inputs", str(N_INPUTS)]
    done = subprocess.run(command, capture_output=True, text=True, timeout=300, cwd=targets.HERE.parents[1])
    assert done.returncode == 0, done.stdout + done.stderr
    read = dict(line.split(": ", 1) for line in done.stdout.splitlines())
    assert read.keys() == TARGETS.keys()
    for name, said in read.items():
        n_read, n_taken = (int(said.split()[i]) for i in (0, 3))
        assert n_read >= N_INPUTS
        assert 0 < n_taken < n_read, name  # changes are neither all harmless nor all the same nonsense


@pytest.mark.slow
@pytest.mark.skipif(importlib.util.find_spec("atheris") is None, reason="atheris has no wheel for this machine")
@pytest.mark.parametrize("name", TARGETS)
def test_fuzzing_guided_by_coverage_finds_nothing(name, tmp_path, trust):
    n, finding = fuzz(name, SECONDS, tmp_path)
    assert finding == ""
    trust(
        "fuzzing",
        "No file makes a reader crash, hang, write, import something or take much memory.",
        topic="damage",
        figure=n,
        unit="inputs read without a finding",
        at_least=1000,
        over="sum",
        command="make fuzz",
    )


def write(folder):
    (folder / "file").write_bytes(b"x")


FORBIDDEN = {
    "writes": write,
    "makes a folder": lambda folder: (folder / "new").mkdir(),
    "removes": lambda folder: (folder / "there").unlink(),
    "starts a process": lambda folder: subprocess.run([sys.executable, "--version"], check=True),
    "unpickles": lambda folder: pickle.loads(pickle.dumps(Path)),
    "takes much memory": lambda folder: np.ones(4 * 10**7),
    "takes long": lambda folder: sum(range(10**7)),
    "writes and swallows the error": lambda folder: [write(folder), None][1],
    "imports": lambda folder: importlib.import_module("strangers_module"),
}


@pytest.mark.parametrize("what", FORBIDDEN)
def test_whatever_a_reader_must_not_do_is_found(what, tmp_path, monkeypatch):
    (tmp_path / "there").touch()
    (tmp_path / "strangers_module.py").write_text("")
    monkeypatch.syspath_prepend(tmp_path)
    monkeypatch.setattr(guard, "SECONDS", 0.05)
    if what == "takes much memory":
        monkeypatch.setattr(guard, "SECONDS", 20)
    with pytest.raises(guard.FindingError), guard.reading_only():
        FORBIDDEN[what](tmp_path)
    sys.modules.pop("strangers_module", None)


def test_another_error_than_ours_is_found(tmp_path, monkeypatch):
    targets.warm_up("grids", tmp_path)
    assert not targets.run("grids", b"[[grid]]\nloss = 'mse'", tmp_path)
    monkeypatch.setattr(grid, "expand", lambda *_: {}["eta"])
    with pytest.raises(KeyError):
        targets.run("grids", b"[[grid]]", tmp_path)


def test_changes_keep_checksums_right_and_the_corpus_is_small(tmp_path):
    """Most changed checkpoints and plans come to where their content is looked at, behind the checksum."""
    draw = random.Random(0)
    for name, told in (("checkpoints", "its checksum is wrong"), ("plans", "was damaged")):
        target, errors = TARGETS[name], []
        for _ in range(40):
            target.place(target.change(targets.seeds(name)[0], draw), tmp_path)
            try:
                target.read(tmp_path)
            except targets.ERRORS as error:
                errors.append(str(error))
        assert sum(told not in error for error in errors) > 5, name
    sizes = [path.stat().st_size for path in (targets.HERE / "corpus").rglob("*") if path.is_file()]
    assert 0 < sum(sizes) < 100_000
