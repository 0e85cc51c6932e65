"""Result folders that are whole or not there."""

import contextlib
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
    path = path.absolute()
    if path.exists() and not path.is_dir():
        raise UsageError(f"out is {path}, which is a file; name a folder")
    if path.exists() and any(path.iterdir()) and not overwrite:
        raise UsageError(f"out is {path}, which is in use; name another folder or give --overwrite")
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        scratch = Path(tempfile.mkdtemp(prefix=f".{path.name}.", dir=path.parent))
    except OSError as error:
        raise UsageError(f"out is {path}, which can't be written: {error.strerror}; name another folder") from None
    lock = filelock.FileLock(path.parent / f".{path.name}.lock", blocking=False)
    try:
        lock.acquire()
        fresh = scratch / "new"
        fresh.mkdir()
        yield fresh
        if path.exists():
            path.replace(scratch / "old")
        fresh.replace(path)
    except filelock.Timeout:
        raise UsageError(f"out is {path}, which another process is filling; name another folder") from None
    finally:
        shutil.rmtree(scratch, ignore_errors=True)
        if lock.is_locked:
            Path(lock.lock_file).unlink(missing_ok=True)
            lock.release()
