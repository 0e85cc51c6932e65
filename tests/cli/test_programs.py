"""What one command compiled the next one finds, whatever became of the first."""

import os
import subprocess
import sys
import zlib

import pytest

from galton.cli._program_faults import keep_programs
from galton.training import programs_on_disk

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
model = galton.A2C("bandit", "gaussian", net_arch=(4,))
assert not jax.config.jax_compilation_cache_dir
model.learn(10, progress_bar=False)
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


def test_those_that_were_not_used_for_longest_make_room(monkeypatch, tmp_path):
    for age in range(4):
        path = tmp_path / str(age)
        path.write_bytes(zlib.compress(os.urandom(900)))
        os.utime(path, (1e9 - age, 1e9 - age))
    monkeypatch.setattr(programs_on_disk, "MOST", 2000)
    programs_on_disk.tidy(tmp_path)
    assert {path.name for path in entries(tmp_path)} == {"0", "1"}
