"""What a reader must not do, whatever it is given: write, start something, import, take long or take much memory."""

import contextlib
import os
import sys
import time
from collections.abc import Iterator
from pathlib import Path

SECONDS = 20
"""CPU time that one input may take."""
MEGABYTES = 250
"""How much more memory than before one input may take at its peak."""
CHANGING = (
    *("os.chmod", "os.chown", "os.link", "os.mkdir", "os.remove", "os.rename", "os.rmdir", "os.symlink"),
    *("os.truncate", "os.utime", "os.setxattr", "shutil.", "tempfile."),
)
"""How the names of events begin by which files change."""
STARTING = ("subprocess.Popen", "os.system", "os.exec", "os.fork", "os.posix_spawn", "os.spawn", "socket.", "ctypes.dl")
"""How the names of events begin by which something starts that is no reading."""
PICKLED = ("pickle.find_class", "marshal.load")
"""How the names of events begin by which a file would say what code runs."""

_FORBIDDEN = (*CHANGING, *STARTING, *PICKLED)
_STATUS, _RESET = Path("/proc/self/status"), Path("/proc/self/clear_refs")
_PROGRAMS = os.environ.get("JAX_COMPILATION_CACHE_DIR")
_seen: list[str] | None = None


class FindingError(AssertionError):
    """A reader did what it must not do."""


@contextlib.contextmanager
def reading_only() -> Iterator[None]:
    """A time to read files and compute in, within SECONDS and MEGABYTES; FindingError says what else was done."""
    global _seen
    modules, start = set(sys.modules), time.process_time()
    before = _begin_peak()
    _seen = seen = []
    try:
        yield
    finally:
        _seen = None
    seconds, megabytes = time.process_time() - start, (_peak() - before) / 1024
    new = {name.partition(".")[0] for name in set(sys.modules) - modules} - _known(modules)
    if seen or new:
        raise FindingError(f"it did {seen}, and imported {sorted(new)}")
    if seconds > SECONDS or megabytes > MEGABYTES:
        raise FindingError(f"it took {seconds:.1f} s and {megabytes:.0f} MB")


def _known(modules: set[str]) -> set[str]:
    return {name.partition(".")[0] for name in modules} | sys.stdlib_module_names


def _heard(event: str, arguments: tuple[object, ...]) -> None:
    if _seen is None:
        return
    if event == "open":
        path, mode, flags = arguments
        if _PROGRAMS and str(path).startswith(_PROGRAMS):  # where the tests have JAX keep what it compiles
            return
        writes = isinstance(flags, int) and flags & (os.O_WRONLY | os.O_RDWR | os.O_CREAT | os.O_TRUNC | os.O_APPEND)
        if writes or set(str(mode)) & {*"wax+"}:
            _seen.append(f"open {arguments}"[:200])
    elif event.startswith(_FORBIDDEN) and not _in_import():
        _seen.append(f"{event} {arguments}"[:200])


def _in_import() -> bool:
    """Whether Python is loading a module, which unmarshals its code and opens its libraries."""
    frame = sys._getframe(2)
    while frame is not None:
        if frame.f_globals.get("__name__") == "importlib._bootstrap":
            return True
        frame = frame.f_back
    return False


def _begin_peak() -> int:
    """Let the peak of this process's memory begin anew, and return it in kilobytes."""
    with contextlib.suppress(OSError):  # Linux's
        _RESET.write_text("5")
    return _peak()


def _peak() -> int:
    if not _STATUS.exists():
        return 0
    return int(_STATUS.read_text().partition("VmHWM:")[2].split()[0])


sys.addaudithook(_heard)
