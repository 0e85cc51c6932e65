"""Whole files or none."""

import errno
import os
import platform
import subprocess
import sys
import uuid

import fsspec
import pytest
from fsspec.implementations.memory import MemoryFileSystem

from galton.errors import UsageError
from galton.saving import files
from galton.saving.files import SCRATCH
from galton_experiments.sweep.store import Store


@pytest.fixture(params=["local", "object store"])
def place(request, tmp_path):
    return Store(str(tmp_path / "sweep") if request.param == "local" else f"memory://{uuid.uuid4()}")


def test_what_is_written_is_read_and_listed(place):
    assert place.names("shards") == []
    place.write("shards/b", b"2")
    place.write("shards/a", b"1")
    place.write("shards/b", b"3")
    assert place.names("shards") == ["a", "b"]
    assert place.read("shards/b") == b"3"
    place.remove("shards/b")
    place.remove("shards/b")
    assert place.names("shards") == ["a"]
    with pytest.raises(FileNotFoundError):
        place.read("shards/b")


def test_a_second_process_is_refused_and_a_dead_ones_lock_is_free(tmp_path):
    place = Store(str(tmp_path))
    holder = (
        "import sys, time; from galton_experiments.sweep.store import Store\n"
        f"with Store({str(tmp_path)!r}).lock(): print('held', flush=True); time.sleep(60)"
    )
    with subprocess.Popen([sys.executable, "-c", holder], stdout=subprocess.PIPE) as process:
        process.stdout.readline()
        with pytest.raises(UsageError, match="another process runs a sweep"), place.lock():
            pass
        process.kill()
    with place.lock():
        pass


def test_what_a_killed_process_left_is_cleared_away(place):
    place.write("shards/a", b"1")
    if place.local is not None:
        with subprocess.Popen([sys.executable, "-c", ""]) as dead:
            pass
        for process_id in (dead.pid, os.getpid()):
            (place.local / "shards" / f"{SCRATCH}{platform.node()}-{process_id}-x").write_bytes(b"half")
        # Of machines whose names begin like ours.
        elsewhere = {f"{SCRATCH}{platform.node()}-{more}-{dead.pid}-x" for more in ("compute-0", dead.pid)}
        for name in elsewhere:
            (place.local / "shards" / name).write_bytes(b"half")
    assert place.names("shards") == ["a"]
    with place.lock():
        if place.local is not None:
            kept = {"a", f"{SCRATCH}{platform.node()}-{os.getpid()}-x", *elsewhere}  # their writers live
            assert {path.name for path in (place.local / "shards").iterdir()} == kept


def test_what_is_left_behind_while_a_sweep_runs_is_cleared_away_in_the_end(tmp_path):
    with subprocess.Popen([sys.executable, "-c", ""]) as dead:
        pass
    with Store(str(tmp_path)).lock():
        (tmp_path / f"{SCRATCH}{platform.node()}-{dead.pid}-x").write_bytes(b"half")
    assert [path.name for path in tmp_path.iterdir() if path.name != ".lock"] == []


def test_a_new_folder_goes_again_where_a_sweep_is_refused(tmp_path):
    new, old = tmp_path / "new", tmp_path / "old"
    old.mkdir()
    for folder in (new, old):
        with pytest.raises(UsageError, match="refused"), Store(str(folder)).lock():
            raise UsageError("refused")
    assert (new.exists(), old.exists()) == (False, True)
    with Store(str(new)).lock():
        Store(str(new)).write("a", b"1")
    assert (new / "a").exists()


def test_files_that_others_write_to_an_object_store_are_seen():
    class Remembering(MemoryFileSystem):
        """Like S3's: it keeps what a folder held until it is told not to."""

        protocol = "remembering"

        def ls(self, path, detail=True, **kwargs):
            if path not in self.dircache:
                self.dircache[path] = super().ls(path, detail=False, **kwargs)
            return self.dircache[path]

        def invalidate_cache(self, path=None):
            self.dircache.clear()

    fsspec.register_implementation("remembering", Remembering, clobber=True)
    place = Store(f"remembering://{uuid.uuid4()}")
    place.write("shards/a", b"1")
    assert place.names("shards") == ["a"]
    MemoryFileSystem().pipe_file(f"{place._root}/shards/b", b"2")
    assert place.names("shards") == ["a", "b"]


def test_a_process_in_another_folder_finds_the_place(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    place = Store("sweep")
    assert place.absolute == str(tmp_path.resolve() / "sweep")
    assert Store("memory://sweep").absolute == "memory://sweep"


@pytest.mark.parametrize("number", [errno.ENOSPC, errno.EDQUOT])
@pytest.mark.parametrize("step", ["write", "fsync", "replace"])
def test_a_full_disk_is_told_and_leaves_the_old_file(tmp_path, monkeypatch, step, number):
    place = Store(str(tmp_path))
    place.write("a", b"old")

    def full(*_):
        raise OSError(number, os.strerror(number))

    if step == "write":
        monkeypatch.setattr(files.Path, "write_bytes", full)
    elif step == "fsync":
        monkeypatch.setattr(files.os, "fsync", full)
    else:
        monkeypatch.setattr(files.Path, "replace", full)
    with pytest.raises(UsageError, match=r"no room left .* run the same command again"):
        place.write("a", b"new")
    assert place.read("a") == b"old"
    assert place.names("") == ["a"]
    assert [path.name for path in tmp_path.iterdir()] == ["a"]


def test_a_place_that_cant_be_opened_is_refused():
    with pytest.raises(UsageError, match="out is 'nonsense://x', which can't be opened"):
        Store("nonsense://x")
    with pytest.raises(UsageError, match="can't be written"), Store("/proc/galton").lock():
        pass
