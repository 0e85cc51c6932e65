"""Result folders that are whole or not there."""

import contextlib
import glob
import os
import shutil
import tempfile
from collections.abc import Iterator
from pathlib import Path

import filelock

from galton.errors import UsageError


@contextlib.contextmanager
def result_folder(path: Path, overwrite: bool) -> Iterator[Path]:
    """A hidden folder beside `path` to write into; it becomes `path` at the end, or vanishes if that is never reached.

    Raises:
        UsageError: at once, if path holds something and may not be overwritten, or another process is about to fill it.
    """
    path = path.resolve()
    _check_free(path, overwrite)
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        scratch = Path(tempfile.mkdtemp(prefix=f".{path.name}.galton-", dir=path.parent))
    except OSError as error:
        raise UsageError(f"out is {path}, which can't be written: {error.strerror}; name another folder") from None
    lock = filelock.FileLock(path.parent / f".{path.name}.lock", blocking=False)
    try:
        lock.acquire()
        for stale in path.parent.glob(f".{glob.escape(path.name)}.galton-*/"):  # of killed processes: the lock is ours
            if stale != scratch:
                _discard(stale, path)
        _check_free(path, overwrite)
        fresh = scratch / "new"
        fresh.mkdir()
        yield fresh
        if overwrite and path.exists():
            path.replace(scratch / "old")
        try:
            fresh.replace(path)
        except OSError:
            kept = fresh.replace(path.with_name(f"{path.name}-{os.getpid()}"))
            raise UsageError(f"out is {path}, which somebody filled meanwhile; the results are in {kept}") from None
    except filelock.Timeout:
        raise UsageError(f"out is {path}, which another process is filling; name another folder") from None
    finally:
        _discard(scratch, path)
        if lock.is_locked:
            with contextlib.suppress(OSError):  # Windows can't remove an open file
                Path(lock.lock_file).unlink()
            lock.release()


def _check_free(path: Path, overwrite: bool) -> None:
    if path.exists() and not path.is_dir():
        raise UsageError(f"out is {path}, which is a file; name a folder")
    if not path.exists() or not any(path.iterdir()):
        return
    if not overwrite:
        raise UsageError(f"out is {path}, which is in use; name another folder or give --overwrite")
    if not (path / "config.json").exists() or Path.cwd().is_relative_to(path):
        raise UsageError(f"out is {path}, which is not a folder of results and is not overwritten; name another")


def _discard(scratch: Path, path: Path) -> None:
    """Remove a scratch folder, but first put back what it took from `path`, should it hold the only copy."""
    if (scratch / "old").exists() and not path.exists():
        (scratch / "old").replace(path)
    shutil.rmtree(scratch, ignore_errors=True)
