import errno
import io
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


def test_two_that_write_the_same_file_at_once_do_not_share_what_they_write(tmp_path):
    with files.replacing(tmp_path / "file") as one, files.replacing(tmp_path / "file") as other:
        one.write_bytes(b"one")
        other.write_bytes(b"other")
    assert (tmp_path / "file").read_bytes() == b"one"  # the one that ended last
    assert [path.name for path in tmp_path.iterdir()] == ["file"]


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


def test_nothing_written_is_an_error_and_not_an_empty_file_and_permissions_are_those_of_a_new_file(tmp_path):
    with pytest.raises(FileNotFoundError), files.replacing(tmp_path / "file"):
        assert list(tmp_path.iterdir()) == []
    assert list(tmp_path.iterdir()) == []
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
    names[2**70] = f"{files.SCRATCH}{platform.node()}-{2**70}-ab"  # no number of a process
    (tmp_path / "in" / names[2**70]).write_bytes(b"half")
    files.clear(tmp_path)
    (tmp_path / "in" / names[2**70]).unlink()
    for folder in (tmp_path, tmp_path / "in"):
        assert {path.name for path in folder.iterdir()} - {"in"} == {names[os.getpid()], "mine"}


def test_a_line_is_put_behind_the_others(tmp_path):
    path = tmp_path / "file"
    for there, then in ((b"", b""), (b"old\n", b"old\n"), (b"half", b"half\n"), (b"\n", b"\n"), (b"a\r\n", b"a\r\n")):
        files.append_line(path, "new")
        assert path.read_bytes() == b"new\n", "where there was no file"
        path.write_bytes(there)
        files.append_line(path, "new")
        assert path.read_bytes() == then + b"new\n"
        path.unlink()


class Full(io.FileIO):
    """A file on a disk that has room for so many more bytes; fewer than asked for are written, as POSIX has it."""

    room = 0

    def write(self, data):
        if not self.room:
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
        written = super().write(bytes(data)[: self.room])
        Full.room -= written
        return written


@pytest.mark.parametrize("room", [0, 1, 7, 13])
@pytest.mark.parametrize("there", [b"", b"old\n", b"half"])
def test_a_line_that_does_not_fit_leaves_the_file_as_it_was(room, there, tmp_path, monkeypatch):
    path, line = tmp_path / "file", "fourteen bytes"
    path.write_bytes(there)
    monkeypatch.setattr(Full, "room", room)
    monkeypatch.setattr(type(path), "open", lambda self, mode, buffering: Full(self, mode.replace("b", "")))
    with pytest.raises(OSError, match="No space left"):
        files.append_line(path, line)
    monkeypatch.undo()
    assert path.read_bytes() == there
    files.append_line(path, line)
    assert path.read_bytes().splitlines()[-1] == line.encode()
