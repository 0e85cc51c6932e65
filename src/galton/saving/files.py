"""Files that are whole or not there."""

import contextlib
import os
import platform
import re
import secrets
import stat
from collections.abc import Iterator
from pathlib import Path

from galton.errors import UsageError, require

SCRATCH = ".writing-"
"""The beginning of the names of files that are not whole yet; machine and process follow."""
TEXT = 1 << 24
"""The most bytes of a file of settings, which people write or read: over 100 times the longest of ours."""
DATA = 1 << 30
"""The most bytes of a file that grows with what is trained, such as a model, a log or a table: what a memory holds."""
_ODD = {stat.S_IFIFO: "a pipe", stat.S_IFSOCK: "a socket"}


def read(path: Path, most: int) -> bytes:
    """The whole content of a regular file, maybe a stranger's, of so many bytes at most; OSError says what is amiss.

    Nothing else is opened, for a pipe would never end, nor anything larger read.
    """
    _readable_size(path.stat(), most)
    with open(path, "rb", opener=_at_once) as file:  # which Path.open doesn't take
        return file.read(_readable_size(os.fstat(file.fileno()), most))


def _readable_size(found: os.stat_result, most: int) -> int:
    """The size of what was found, in bytes; OSError where it is not to be read."""
    if stat.S_ISDIR(found.st_mode):
        raise IsADirectoryError("it is a folder; name a file")
    if not stat.S_ISREG(found.st_mode):
        raise OSError(f"it is {_ODD.get(stat.S_IFMT(found.st_mode), 'a device')}; name a regular file")
    if found.st_size > most:
        raise OSError(f"its size is {found.st_size:,} bytes, and it may have {most:,}; name another file")
    return found.st_size


def _at_once(path: str, flags: int) -> int:
    """Open a file without waiting, should it have become a pipe meanwhile."""
    return os.open(path, flags | getattr(os, "O_NONBLOCK", 0))


def write(path: Path, data: bytes) -> None:
    """Put all of the data at path, even if the machine stops meanwhile, or leave what was there; OSError if not."""
    with replacing(path) as scratch:
        scratch.write_bytes(data)


@contextlib.contextmanager
def replacing(path: Path) -> Iterator[Path]:
    """A scratch file beside `path` to write; it becomes `path` at the end, or vanishes if that is never reached.

    It has the suffix of `path`, by which some writers choose a format. A link stays: what it points to is replaced.
    """
    path = _target(path)
    scratch = path.with_name(f"{SCRATCH}{platform.node()}-{os.getpid()}-{secrets.token_hex(4)}{path.suffix}")
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        yield scratch
        with scratch.open("r+b") as file:
            os.fsync(file.fileno())
        scratch.replace(path)
    finally:
        with contextlib.suppress(OSError):
            scratch.unlink(missing_ok=True)


def check_no_way_out(name: str, folder: Path, *files: str) -> None:
    """Raise UsageError, which calls the folder by this name, where a link leads one of its files elsewhere.

    A folder that somebody else filled may hold one. The folder itself may be a link, since its user named it.
    """
    top = _target(folder)
    for file in files:
        place = _target(top / file)
        require(
            place.is_relative_to(top),
            f"{name} is {folder}, whose {file} leads out of it by a link, to {place}; remove the link",
        )


def _target(path: Path) -> Path:
    """The path that a path leads to in the end; a link that leads back to itself is where it ends."""
    return Path(os.path.realpath(path))


def check_text(name: str, path: str | Path) -> None:
    """Raise UsageError, which calls the path by this name, where no path can be of that text."""
    require("\0" not in str(path), f"{name} is {str(path)!r}, with a NUL, which no path can have; leave it out")


def check_name(name: str, path: Path) -> None:
    """Raise UsageError, which calls the path by this name, where it names no file."""
    check_text(name, path)
    require(
        path.name not in ("", ".."), f"{name} is {str(path)!r}, which names no file; give a name such as runs/model"
    )


@contextlib.contextmanager
def named(name: str, path: str | Path) -> Iterator[None]:
    """Turn the error of a path that can't be written into a UsageError that calls it by this name."""
    check_text(name, path)
    try:
        with contextlib.suppress(FileNotFoundError, NotADirectoryError):
            os.lstat(path)  # an error for a name that is too long, which Path.exists keeps back from Python 3.14 on
        yield
    except OSError as error:
        raise UsageError(f"{name} is {path}, which can't be written: {error.strerror or error}; name another") from None


def check_place(name: str, path: Path) -> None:
    """Raise UsageError, which calls the path by this name, where no file can be made; its folder is."""
    check_name(name, path)
    with named(name, path):
        path.parent.mkdir(parents=True, exist_ok=True)
        writable = os.access(path.parent, os.W_OK)
    require(writable, f"{name} is {path}, which can't be written: its folder is read-only; name another")


def append_line(path: Path, text: str) -> None:
    """Put a line behind a file's whole ones, all of it or nothing; OSError where it can't be, as on a full disk."""
    with path.open("a+b", buffering=0) as file:
        end = file.seek(0, os.SEEK_END)
        if end:
            file.seek(end - 1)
            text = text if file.read(1) == b"\n" else f"\n{text}"
        left = memoryview(f"{text}\n".encode())
        try:
            while left:
                left = left[file.write(left) :]
        except OSError:
            file.truncate(end)
            raise


def clear(folder: Path) -> None:
    """Remove what processes of this machine left half-written in a folder and those in it when they were killed."""
    if os.name != "posix":  # elsewhere nobody can ask whether a process lives
        return
    ours = re.compile(rf"{re.escape(SCRATCH + platform.node())}-(\d+)-[^-]*")
    for scratch in [*folder.glob(f"{SCRATCH}*"), *folder.glob(f"*/{SCRATCH}*")]:
        if match := ours.fullmatch(scratch.name):
            try:
                os.kill(int(match[1]), 0)
            except ProcessLookupError:
                scratch.unlink(missing_ok=True)
            except (OSError, OverflowError):
                continue
