"""The folder of a sweep, on a disk, a shared file system or an object store: whole files or none."""

import contextlib
import errno
import hashlib
import os
import re
from collections.abc import Iterator
from pathlib import Path, PureWindowsPath

import filelock
import fsspec
from fsspec.implementations.local import LocalFileSystem

from galton.errors import UsageError, require
from galton.saving import files

_LOCK = ".lock"


class Store:
    """The files of one place, read and written whole by their names.

    Args:
        url: a path, or whatever fsspec opens (`s3://bucket/sweep` with s3fs installed).
        top: the folder on a disk that nothing is written out of, whatever links it holds; by default the place itself.

    Raises:
        UsageError: fsspec can't open the place.
    """

    def __init__(self, url: str, top: Path | None = None) -> None:
        files.check_text("out", url)
        try:
            self._files, self._root = fsspec.core.url_to_fs(url)
        except (ImportError, ValueError) as error:
            raise UsageError(f"out is {url!r}, which can't be opened: {error}") from None
        self.url = url
        self.local = Path(self._root) if isinstance(self._files, LocalFileSystem) else None
        self._top = top or self.local

    def below(self, folder: str) -> "Store":
        """The files of a folder in this one."""
        return Store(f"{self.url}/{folder}", self._top)

    @property
    def absolute(self) -> str:
        """Its address for a process that works in another folder."""
        return self.url if self.local is None else str(self.local.resolve())

    def names(self, folder: str) -> list[str]:
        """The files of a folder, sorted; none where there is no such folder."""
        if self.local is not None:
            try:
                with os.scandir(self.local / folder) as entries:
                    return sorted(entry.name for entry in entries if not entry.name.startswith(files.SCRATCH))
            except FileNotFoundError:
                return []
            except OSError as error:
                raise UsageError(f"out is {self.url}, where {folder or 'it'} can't be read: {error}") from None
        self._files.invalidate_cache()  # others write here too
        try:
            return sorted(path.rsplit("/", 1)[-1] for path in self._files.ls(f"{self._root}/{folder}", detail=False))
        except FileNotFoundError:
            return []

    def read(self, name: str) -> bytes:
        """The content of a whole file.

        Raises:
            FileNotFoundError: there is none.
            UsageError: it can't be read.
        """
        try:
            if self.local is not None:
                return files.read(Path(self._at(name)), files.DATA)
            return self._files.cat_file(self._at(name))
        except FileNotFoundError:
            raise
        except OSError as error:
            raise UsageError(f"out is {self.url}, where {name} can't be read: {error}") from None

    def write(self, name: str, data: bytes) -> None:
        """Write all of a file or nothing, even if the machine stops meanwhile; what had that name is replaced.

        Raises:
            UsageError: no room, or no permission.
        """
        place = self._own(name)
        try:
            if self.local is not None:
                files.write(Path(place), data)
            else:
                self._files.pipe_file(place, data)
        except OSError as error:
            if error.errno in (errno.ENOSPC, errno.EDQUOT):
                raise UsageError(
                    f"out is {self.url}, where there is no room left ({error.strerror}); make room and run the same "
                    "command again, which goes on where this one stopped"
                ) from None
            raise UsageError(f"out is {self.url}, where {name} can't be written: {error}") from None

    def remove(self, name: str) -> None:
        """Remove a file, if it is there."""
        with contextlib.suppress(FileNotFoundError):
            self._files.rm_file(self._own(name))

    def _at(self, name: str) -> str:
        """The address of a file; UsageError for a name that leads out of the folder."""
        check_inside("name", name)
        return f"{self._root}/{name}"

    def _own(self, name: str) -> str:
        """The address of a file that may be changed; UsageError where a link leads out of the folder to it."""
        place = self._at(name)
        if self._top is not None:
            files.check_no_way_out("out", self._top, str(Path(place).relative_to(self._top)))
        return place

    @contextlib.contextmanager
    def lock(self) -> Iterator[None]:
        """Hold the sweep for this process alone; what killed ones left half-written is cleared away.

        A folder that was made for it and gets no file, since what was asked for is refused, is removed.

        An object store has no locks: there two of the same sweep would do the same work twice, and the workers of
        two that differ would refuse.

        Raises:
            UsageError: another process holds it.
        """
        if self.local is None:
            yield
            return
        try:
            new = not self.local.exists()
            self._own(_LOCK)
            self.local.mkdir(parents=True, exist_ok=True)
            lock = filelock.FileLock(self.local / _LOCK, blocking=False)
            lock.acquire()
        except filelock.Timeout:
            raise UsageError(f"out is {self.url}, where another process runs a sweep; wait for it") from None
        except OSError as error:
            raise UsageError(f"out is {self.url}, which can't be written: {error}") from None
        try:
            files.clear(self.local)
            yield
        finally:
            files.clear(self.local)
            with contextlib.suppress(OSError):  # Windows keeps a file that is open; the folder is then left
                if new and [path.name for path in self.local.iterdir()] == [_LOCK]:
                    (self.local / _LOCK).unlink()  # while it is held, so that nobody has just taken it
                    self.local.rmdir()
            lock.release()


def checksum(data: bytes) -> str:
    """The checksum of some bytes: 32 hexadecimal digits."""
    return hashlib.sha256(data).hexdigest()[:32]


def check_inside(name: str, value: str) -> None:
    """Raise UsageError, which calls the value by this name, unless it is the path of a file inside a folder.

    What stands in a registry may become one. It is the same on every system.
    """
    parts = re.split(r"[/\\]", value)
    inside = "\0" not in value and not {"", ".", ".."} & {*parts} and not PureWindowsPath(value).drive
    require(inside, f"{name} is {value!r}, which is no name of a file in a folder; leave out '..' and what leads away")
