"""A folder of compiled programs that is read-only, full or damaged costs time and one line, and changes no result."""

import os
import subprocess
import sys
import warnings
import zlib
from pathlib import Path

import pytest

from galton.cli import _program_faults
from galton.training import programs_on_disk

from .test_programs import entries, keeping

SMALL = """
import errno, os, pathlib, resource, sys
def failing(name, number):
    own = getattr(pathlib.Path, name)
    def call(path, *arguments, **keywords):
        if path.parent.name.startswith("jax-"):
            raise OSError(number, os.strerror(number), str(path))
        return own(path, *arguments, **keywords)
    setattr(pathlib.Path, name, call)
{before}
from galton.cli._program_faults import keep_programs
keep_programs()
{after}
import jax
print(jax.jit(lambda x: x * 2 + 1)(3.0))
"""
"""A process that keeps programs as a command does, and compiles one."""
PLACES = {
    "read-only": ("failing('touch', errno.EROFS)", "", "Read-only file system"),
    "full at the start": ("failing('write_bytes', errno.ENOSPC)", "", "No space left on device"),
    "full later": ("", "resource.setrlimit(resource.RLIMIT_FSIZE, (100, 100))", "File too large"),
}


def compiled(programs, before="", after=""):
    """The lines of standard error of such a process, which must have computed what it should."""
    # Nor is it measured: what a full disk does to the lines that were run is not asked.
    environment = keeping(programs, "COVERAGE_")
    command = [sys.executable, "-c", SMALL.format(before=before, after=after)]
    done = subprocess.run(command, capture_output=True, text=True, env=environment, timeout=120)
    assert (done.returncode, done.stdout) == (0, "7.0\n"), done.stderr
    return done.stderr.splitlines()


def rot(programs):
    """Damage every program in a way that no check of the times finds: packed well, cut off, or other bytes."""
    kept = entries(programs)
    damages = [lambda _: zlib.compress(b"abcdef"), lambda data: data[: len(data) // 2], lambda data: bytes(len(data))]
    for i, (path, data) in enumerate(kept.items()):
        path.write_bytes(damages[i % 3](data))
        os.utime(path, (1e9, 1e9))
    return kept


@pytest.mark.few
@pytest.mark.parametrize("fault", PLACES)
def test_a_folder_that_takes_nothing_is_told_in_a_line(fault, tmp_path):
    before, after, why = PLACES[fault]
    (line,) = compiled(tmp_path, before, after)
    assert line.startswith("galton: compiled programs are not kept: ")
    assert line.endswith("; GALTON_PROGRAMS names another folder, or is off")
    assert why in line
    assert all(len(data) <= 100 for data in entries(tmp_path).values())


@pytest.mark.slow
def test_programs_that_rotted_are_told_in_a_line_and_kept_anew(tmp_path):
    assert compiled(tmp_path) == []
    kept = rot(tmp_path)
    assert kept
    (line,) = compiled(tmp_path)
    assert line.startswith("galton: compiled programs can't be read and are made again: ")
    again = entries(tmp_path)
    assert again.keys() == kept.keys()
    assert all(zlib.decompress(data) != b"abcdef" for data in again.values())


def test_a_place_that_can_not_be_is_told(monkeypatch, capsys):
    for given in ("a\0b", "n" * 300, "/dev/null/programs", "/proc/galton"):
        monkeypatch.setattr(programs_on_disk.os, "environ", {programs_on_disk.PLACE: given})
        _program_faults.keep_programs()
        (line,) = capsys.readouterr().err.splitlines()
        assert line.startswith("galton: compiled programs are not kept: ")
        assert "JAX_COMPILATION_CACHE_DIR" not in os.environ


def test_other_warnings_are_shown_as_ever_and_workers_are_quiet(tmp_path, monkeypatch, capsys):
    shown = []
    monkeypatch.setattr(warnings, "showwarning", lambda *arguments: shown.append(str(arguments[0])))
    monkeypatch.setenv("PYTHONWARNINGS", "error::ResourceWarning")
    _program_faults.tell_once(tmp_path, "do something")
    with warnings.catch_warnings():
        warnings.simplefilter("always")
        warnings.warn("something else", stacklevel=1)
        for _ in range(3):
            warnings.warn("Error writing persistent compilation cache entry for 'jit_f': OSError: full", stacklevel=1)
    assert shown == ["something else"]
    assert capsys.readouterr().err == "galton: compiled programs are not kept: OSError: full; do something\n"
    worker = "import warnings; warnings.warn('Error writing persistent compilation cache entry for x'); print('done')"
    done = subprocess.run([sys.executable, "-c", worker], capture_output=True, text=True, check=True)
    assert (done.stdout, done.stderr) == ("done\n", "")


def test_files_that_another_process_removes_meanwhile_are_no_fault(tmp_path, monkeypatch):
    for name in ("one", "two"):
        (tmp_path / name).write_bytes(b"no program")
    own = Path.is_file
    monkeypatch.setattr(Path, "is_file", lambda path: own(path) and (path.name == "two" or path.unlink() is None))
    programs_on_disk.tidy(tmp_path)
    monkeypatch.undo()
    assert not entries(tmp_path)
