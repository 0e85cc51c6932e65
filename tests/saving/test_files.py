import os
import platform
import subprocess
import sys

import pytest

from galton.saving import files


def test_a_file_appears_whole_under_its_own_suffix(tmp_path):
    with files.replacing(tmp_path / "new" / "film.gif") as scratch:
        assert scratch.suffix == ".gif"
        scratch.write_bytes(b"half")
        assert not (tmp_path / "new" / "film.gif").exists()
        scratch.write_bytes(b"whole")
    assert (tmp_path / "new" / "film.gif").read_bytes() == b"whole"
    assert [path.name for path in (tmp_path / "new").iterdir()] == ["film.gif"]


@pytest.mark.parametrize("error", [RuntimeError, KeyboardInterrupt])
def test_what_fails_on_the_way_leaves_the_old_file(tmp_path, error):
    files.write(tmp_path / "file", b"old")

    def fail():
        with files.replacing(tmp_path / "file") as scratch:
            scratch.write_bytes(b"half")
            raise error

    with pytest.raises(error):
        fail()
    assert (tmp_path / "file").read_bytes() == b"old"
    assert [path.name for path in tmp_path.iterdir()] == ["file"]


def test_nothing_written_is_an_error_and_not_an_empty_file(tmp_path):
    with pytest.raises(FileNotFoundError), files.replacing(tmp_path / "file"):
        assert list(tmp_path.iterdir()) == []
    assert list(tmp_path.iterdir()) == []


@pytest.mark.skipif(os.name != "posix", reason="permissions are POSIX's")
def test_it_gets_the_permissions_that_a_new_file_gets(tmp_path):
    (tmp_path / "plain").write_bytes(b"")
    files.write(tmp_path / "ours", b"")
    assert (tmp_path / "ours").stat().st_mode == (tmp_path / "plain").stat().st_mode


def test_clearing_takes_what_dead_processes_left_and_nothing_else(tmp_path):
    (tmp_path / "in").mkdir()
    with subprocess.Popen([sys.executable, "-c", ""]) as dead:
        pass
    names = {number: f"{files.SCRATCH}{platform.node()}-{number}-0123abcd.mp4" for number in (dead.pid, os.getpid())}
    for folder in (tmp_path, tmp_path / "in"):
        for name in (*names.values(), "mine"):
            (folder / name).write_bytes(b"half")
    files.clear(tmp_path)
    for folder in (tmp_path, tmp_path / "in"):
        assert {path.name for path in folder.iterdir()} - {"in"} == {names[os.getpid()], "mine"}
