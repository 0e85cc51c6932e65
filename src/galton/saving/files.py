"""Files that are whole or not there."""

import contextlib
import os
import platform
import re
import secrets
from collections.abc import Iterator
from pathlib import Path, PureWindowsPath

from galton.errors import UsageError, require

SCRATCH = ".writing-"
"""How the names of files begin that are not whole yet; machine and process follow."""


def write(path: Path, data: bytes) -> None:
    """Put all of the data at path, even if the machine stops meanwhile, or leave what was there.

    Raises:
        OSError: a path that can't be written.
    """
    with replacing(path) as scratch:
        scratch.write_bytes(data)


@contextlib.contextmanager
def replacing(path: Path) -> Iterator[Path]:
    """A scratch file beside `path` to write; it becomes `path` at the end, or vanishes if that is never reached.

    It has the suffix of `path`, by which some writers choose a format. A link stays: what it points to is replaced.

    Raises:
        OSError: a path that can't be written.
    """
    path = path.resolve()
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


def check_inside(name: str, value: str) -> None:
    """Raise UsageError, which calls the value by this name, unless it is the path of a file inside a folder.

    What stands in a registry may become one. It is the same on every system.
    """
    parts = re.split(r"[/\\]", value)
    inside = "\0" not in value and not {"", ".", ".."} & {*parts} and not PureWindowsPath(value).drive
    require(inside, f"{name} is {value!r}, which is no name of a file in a folder; leave out '..' and what leads away")


def check_text(name: str, path: str | Path) -> None:
    """Raise UsageError, which calls the path by this name, where no path can be of that text."""
    require("\0" not in str(path), f"{name} is {str(path)!r}, with a NUL, which no path can have; leave it out")


def check_name(name: str, path: Path) -> None:
    """Raise UsageError, which calls the path by this name, where it names no file."""
    check_text(name, path)
    require(
        path.name not in ("", ".."), f"{name} is {str(path)!r}, which names no file; give a name such as runs/model"
    )


def check_place(name: str, path: Path) -> None:
    """Raise UsageError, which calls the path by this name, where no file can be made; its folder is."""
    check_name(name, path)
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        path.exists()  # an error for a name that is too long
        writable = os.access(path.parent, os.W_OK)
    except OSError as error:
        raise UsageError(f"{name} is {path}, which can't be written: {error.strerror}; name another") from None
    require(writable, f"{name} is {path}, which can't be written: its folder is read-only; name another")


def append_line(path: Path, text: str) -> None:
    """Put a line behind those of a file, all of it or nothing; it begins anew where the last one broke off.

    Raises:
        OSError: a path that can't be written, or a disk that is full.
    """
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
            except OSError:
                continue
