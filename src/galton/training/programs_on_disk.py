"""Compiled programs on disk: what one process has compiled the next one finds. JAX keeps them; where, is said here."""

import contextlib
import functools
import hashlib
import importlib
import os
import platform
import time
import warnings
import zlib
from importlib.metadata import version
from pathlib import Path
from typing import Any

import platformdirs

PLACE = "GALTON_PROGRAMS"
"""The variable of the environment that names another folder for them, or is "off"."""
MOST = 10**9
"""Bytes that they may take; those that were not used for longest go first."""

REMEDY = f"{PLACE} names another folder, or is off"
"""The remedy for a folder that can't be used."""


def place() -> Path | None:
    """The tidied folder for programs, None if the user wants none or another; OSError or ValueError if it can't be."""
    given = os.environ.get(PLACE) or platformdirs.user_cache_dir("galton")
    if given == "off" or "JAX_COMPILATION_CACHE_DIR" in os.environ:
        return None
    folder = Path(given, _kind())
    folder.mkdir(parents=True, exist_ok=True)
    tidy(folder)
    return folder


@functools.cache
def keep_programs() -> None:
    """Have this process keep what it compiles from now on, once, unless the user has told JAX where to.

    A folder that can't be written is told by a warning, and nothing is kept.
    """
    import jax

    if jax.config.jax_compilation_cache_dir is not None:  # type: ignore[attr-defined]
        return
    try:
        folder = place()
    except (OSError, ValueError) as error:  # of a name with a character that none can have
        warnings.warn(f"compiled programs are not kept: {error}; {REMEDY}", stacklevel=2)
        return
    if folder:
        jax.config.update("jax_compilation_cache_dir", str(folder))
        jax.config.update("jax_persistent_cache_min_compile_time_secs", 0.0)


def tidy(folder: Path) -> None:
    """Remove what a killed process left half-written, which JAX would never replace, and the oldest of too many."""
    checked, now = folder / "checked", time.time()
    since = checked.stat().st_mtime if checked.exists() else 0.0
    files = {path: stat for path in folder.iterdir() if path != checked and (stat := _stat(path))}
    for path, stat in files.items():
        if stat.st_mtime >= since and not _is_whole(path):
            path.unlink(missing_ok=True)
    left = sum(stat.st_size for stat in files.values())
    for path, stat in sorted(files.items(), key=lambda file: max(file[1].st_atime, file[1].st_mtime)):
        if left > MOST:
            path.unlink(missing_ok=True)
            left -= stat.st_size
    checked.touch()
    os.utime(checked, (now, now))  # what is written from now on is looked at the next time


def _stat(path: Path) -> os.stat_result | None:
    """The system's record of a file; None for what is none, or that another process has removed meanwhile."""
    try:
        return path.stat() if path.is_file() else None
    except FileNotFoundError:
        return None


def _is_whole(path: Path) -> bool:
    """True if all of a packed program is there, or it is gone altogether."""
    try:
        data = path.read_bytes()
    except FileNotFoundError:
        return True
    try:
        _packer().decompress(data)
    except Exception:  # each packer has errors of its own
        return False
    return True


@functools.cache
def _packer() -> Any:
    """The module that JAX packs programs with in this environment."""
    for name in ("compression.zstd", "zstandard"):  # Python has the first from 3.14 on
        with contextlib.suppress(ImportError):
            return importlib.import_module(name)
    return zlib


def _kind() -> str:
    """The name of a folder for programs that this machine's processor and these versions can run and unpack."""
    cpu = Path("/proc/cpuinfo")
    lines = cpu.read_text().splitlines() if cpu.exists() else [platform.processor()]
    known = {line for line in lines if not cpu.exists() or line.startswith(("model name", "flags", "Features"))}
    told = "\n".join([platform.machine(), *sorted(known)])
    packed = _packer().__name__
    return f"jax-{version('jax')}-{version('jaxlib')}-{packed}-{hashlib.sha256(told.encode()).hexdigest()[:12]}"
