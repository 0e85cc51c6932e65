"""A shard that was begun: kept in a file, and gone on with by the same code alone."""

import contextlib
import functools
import json
import math
import sys
import time
from collections.abc import Callable, Iterable, Sequence
from pathlib import Path

import safetensors.numpy

import galton
from galton.saving import files
from galton.saving.provenance import versions
from galton.training.train import Kept
from galton_experiments.sweep.store import Store, checksum

FOLDER = "shards"
EVERY = 120.0
"""Seconds between two times that a shard which was begun is kept."""


class Begun:
    """A shard that was begun is kept in a file whose name holds its checksum.

    So a worker that is ended loses no more than EVERY seconds, or the way to the next log point.
    """

    def __init__(self, store: Store, name: str, modules: Sequence[str]) -> None:
        self._store, self._name, self._next = store, name, time.monotonic() + EVERY
        self._made_by = made_by(tuple(modules))

    def keep(self, arrays: Callable[[], Kept | None]) -> None:
        """Write it, if the last time was long ago and the environments can tell their states."""
        if time.monotonic() < self._next:
            return
        if (found := arrays()) is not None:
            data = safetensors.numpy.save(found, {"versions": self._made_by})
            if self._store.local and len(data) > files.DATA:  # which could not be read again
                self._next = math.inf
                return
            earlier, file = self._files(), f"{self._name}-{checksum(data)}.begun"
            self._store.write(f"{FOLDER}/{file}", data)
            self._remove(set(earlier) - {file})
        self._next = time.monotonic() + EVERY

    def kept(self) -> Kept | None:
        """The arrays that are kept, of this process's versions and sources; None where there are none, or damaged."""
        for file in self._files():
            with contextlib.suppress(FileNotFoundError):
                data = self._store.read(f"{FOLDER}/{file}")
                if file == f"{self._name}-{checksum(data)}.begun":
                    length = int.from_bytes(data[:8], "little")
                    if json.loads(data[8 : 8 + length])["__metadata__"]["versions"] == self._made_by:
                        return safetensors.numpy.load(data)
        return None

    def forget(self) -> None:
        """Remove what is kept."""
        self._remove(self._files())

    def _files(self) -> list[str]:
        names = self._store.names(FOLDER)
        return [name for name in names if name.startswith(self._name) and name.endswith(".begun")]

    def _remove(self, names: Iterable[str]) -> None:
        for name in names:
            self._store.remove(f"{FOLDER}/{name}")


@functools.cache
def made_by(modules: tuple[str, ...]) -> str:
    """The versions, with a checksum of Galton's own sources in the place of the commit."""
    own = _checksum_of(sorted(Path(galton.__file__).parent.rglob("*.py")))
    return json.dumps(versions_of(modules) | {"commit": own})


@functools.cache
def versions_of(modules: tuple[str, ...]) -> dict[str, str | None]:
    """The versions of Galton and what it needs, and where the study has modules of its own a checksum of their sources.

    They are those of the first time that a process asks: what it has imported does not change with its file.
    """
    sources = [source for name in modules for source in _sources(name)]
    return versions() | ({"modules": _checksum_of(sources)} if sources else {})


def _sources(name: str) -> list[Path]:
    """The files of the package that a module is in, or its own."""
    for known in (name.partition(".")[0], name):
        if file := getattr(sys.modules.get(known), "__file__", None):
            path = Path(file)
            return sorted(path.parent.rglob("*.py")) if path.name == "__init__.py" else [path]
    return []


def _checksum_of(sources: Iterable[Path]) -> str:
    return checksum(b"".join(source.read_bytes() for source in sources))
