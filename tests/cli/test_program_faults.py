"""A folder of compiled programs that is read-only, full or damaged costs time and one line, and changes no result."""

import bz2
import os
import subprocess
import sys
import warnings
import zlib
from pathlib import Path

import pytest

from galton.cli import _program_faults
from galton.cli._program_faults import keep_programs
from galton.training import programs_on_disk

SMALL = """
import builtins, errno, io, os, pathlib, resource, sys
def failing(where, name, number, mode=""):
    own = getattr(where, name)
    def call(path, *arguments, **keywords):
        if mode in str(arguments) and pathlib.Path(str(path)).parent.name.startswith("jax-"):
            raise OSError(number, os.strerror(number), str(path))
        return own(path, *arguments, **keywords)
    setattr(where, name, call)
{before}
from galton.cli._program_faults import keep_programs
keep_programs()
{after}
import jax
print(jax.jit(lambda x: x * 2 + 1)(3.0))
"""
"""A process that keeps programs as a command does, and compiles one."""
PLACES = {
    "read-only": ("failing(pathlib.Path, 'touch', errno.EROFS)", "", "Read-only file system"),
    "full at the start": (
        "for where in (builtins, io): failing(where, 'open', errno.ENOSPC, 'wb')",  # with etils JAX takes the first
        "",
        "No space left on device",
    ),
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


COMPARE = ["compare", "bandit", "--losses=gaussian", "--steps=100", "--seeds=2", "--logs=2", "--overwrite", "--out"]


def keeping(programs, *without):
    """The environment of a process that keeps its programs in a folder, whatever a command has set that ran in this."""
    without = ("JAX_COMPILATION_CACHE", "JAX_PERSISTENT_CACHE", "PYTHONWARNINGS", *without)
    kept = {name: value for name, value in os.environ.items() if not name.startswith(without)}
    return kept | {programs_on_disk.PLACE: str(programs)}


def galton(folder, *words, programs, **environment):
    """A command in a process of its own, which keeps its programs in the folder `programs`."""
    return subprocess.run(
        [sys.executable, "-m", "galton", *words],
        cwd=folder,
        capture_output=True,
        text=True,
        env=keeping(programs) | environment,
        timeout=300,
    )


def entries(folder):
    return {path: path.read_bytes() for path in folder.rglob("*") if path.is_file() and path.name != "checked"}


@pytest.mark.slow
def test_a_second_command_compiles_nothing_a_damaged_program_is_made_again_and_all_have_the_same_bytes(tmp_path):
    programs, told = tmp_path / "programs", []
    for name in ("one", "two", "three"):
        done = galton(tmp_path, *COMPARE, name, programs=programs)
        assert done.returncode == 0, done.stderr
        told.append(done.stderr)
        if name == "one":
            kept = entries(programs)
            assert len(kept) > 2
        assert entries(programs).keys() == kept.keys()
        if name == "two":  # as a process leaves a program that is killed
            assert entries(programs) == kept
            damaged = max(kept, key=lambda path: len(kept[path]))
            damaged.write_bytes(kept[damaged][: len(kept[damaged]) // 2])
    assert zlib.decompress(damaged.read_bytes())
    assert told[2] == told[1]
    (tmp_path / "a file").write_text("")
    done = galton(tmp_path, *COMPARE, "four", programs=tmp_path / "a file")
    assert (done.returncode, done.stderr.count("\n")) == (0, 1)
    assert done.stderr.startswith("galton: compiled programs are not kept: ")
    assert len({(tmp_path / name / "curves.parquet").read_bytes() for name in ("one", "two", "three", "four")}) == 1


MODEL = """
import galton, jax
galton.PPO
assert not jax.config.jax_compilation_cache_dir
galton.A2C("bandit", "gaussian", net_arch=(4,)).learn(10, progress_bar=False)
"""


@pytest.mark.slow
def test_python_keeps_its_programs_where_the_commands_do_and_importing_and_looking_keeps_nothing(tmp_path):
    kept = []
    for name in ("one", "one", "off"):
        environment = keeping(tmp_path / name) | ({programs_on_disk.PLACE: "off"} if name == "off" else {})
        subprocess.run([sys.executable, "-c", MODEL], check=True, env=environment, timeout=300)
        kept.append(entries(tmp_path / name))
    assert len(kept[0]) > 2
    assert kept[1:] == [kept[0], {}]


@pytest.mark.parametrize("environment", [{programs_on_disk.PLACE: "off"}, {"JAX_COMPILATION_CACHE_DIR": "elsewhere"}])
def test_it_is_off_where_the_user_says_so_or_says_where(environment, monkeypatch, tmp_path):
    for name in (programs_on_disk.PLACE, "JAX_COMPILATION_CACHE_DIR", "XDG_CACHE_HOME"):
        monkeypatch.delenv(name, raising=False)
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    for name, value in environment.items():
        monkeypatch.setenv(name, value)
    keep_programs()
    assert os.environ.get("JAX_COMPILATION_CACHE_DIR") == environment.get("JAX_COMPILATION_CACHE_DIR")
    assert not [*tmp_path.iterdir()]


def test_what_is_whole_stays_and_what_is_old_is_not_read_again(tmp_path):
    whole, cut, garbage = (tmp_path / name for name in ("whole", "cut", "garbage"))
    whole.write_bytes(zlib.compress(b"program" * 1000))
    cut.write_bytes(zlib.compress(os.urandom(1000))[:500])
    garbage.write_bytes(b"no program")
    programs_on_disk.tidy(tmp_path)
    assert {*entries(tmp_path)} == {whole}
    whole.write_bytes(b"damaged later")
    os.utime(whole, (0, 0))
    programs_on_disk.tidy(tmp_path)  # only what was written since is looked at
    assert {*entries(tmp_path)} == {whole}


def test_environments_that_pack_programs_otherwise_have_folders_of_their_own(monkeypatch, tmp_path):
    monkeypatch.delenv("JAX_COMPILATION_CACHE_DIR", raising=False)
    monkeypatch.setenv(programs_on_disk.PLACE, str(tmp_path))
    here = programs_on_disk.place()
    (here / "program").write_bytes(zlib.compress(b"program" * 1000))
    monkeypatch.setattr(programs_on_disk, "_packer", lambda: bz2)  # as zstandard in another environment
    assert programs_on_disk.place() != here
    assert (here / "program").exists()


def test_those_that_were_not_used_for_longest_make_room(monkeypatch, tmp_path):
    for age in range(4):
        path = tmp_path / str(age)
        path.write_bytes(zlib.compress(os.urandom(900)))
        os.utime(path, (1e9 - age, 1e9 - age))
    monkeypatch.setattr(programs_on_disk, "MOST", 2000)
    programs_on_disk.tidy(tmp_path)
    assert {path.name for path in entries(tmp_path)} == {"0", "1"}
