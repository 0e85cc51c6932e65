"""What is said where compiled programs can't be kept or read: one line of ours, instead of JAX's at each program."""

import glob
import os
import re
import sys
import warnings
from pathlib import Path
from typing import TextIO

ROOM = 1 << 20
"""Bytes that there must be room for; small programs take some tens of kilobytes, large ones a megabyte."""

_SAID = re.compile(r"Error (reading|writing) persistent compilation cache entry for '([^']*)': (.*)", re.DOTALL)
"""How JAX says that it can't use the folder: what failed, the program's name, and why."""


def check_room(folder: Path) -> None:
    """Raise OSError where nothing of ROOM bytes can be written into a folder."""
    probe = folder / f"probe-{os.getpid()}"
    try:
        probe.write_bytes(bytes(ROOM))
    finally:
        probe.unlink(missing_ok=True)


def tell_once(folder: Path, remedy: str) -> None:
    """Say once in a line what JAX warns of at each program; what could not be read is removed, so that it is kept anew.

    Worker processes say nothing.

    Args:
        folder: where programs are kept.
        remedy: what the user can do about it.
    """
    before, told = warnings.showwarning, set[str]()

    def show(
        message: Warning | str,
        category: type[Warning],
        filename: str,
        lineno: int,
        file: TextIO | None = None,
        line: str | None = None,
    ) -> None:
        said = _SAID.match(str(message))
        if said is None:
            before(message, category, filename, lineno, file, line)
            return
        failed, program, why = said.groups()
        if failed == "reading":
            for path in folder.glob(f"{glob.escape(program)}-*"):
                path.unlink(missing_ok=True)
        if failed not in told:
            told.add(failed)
            what = "are not kept" if failed == "writing" else "can't be read and are made again"
            print(f"galton: compiled programs {what}: {' '.join(why.split())[:200]}; {remedy}", file=sys.stderr)

    warnings.showwarning = show
    quiet = "ignore:Error writing persistent compilation cache,ignore:Error reading persistent compilation cache"
    os.environ["PYTHONWARNINGS"] = ",".join(filter(None, (os.environ.get("PYTHONWARNINGS"), quiet)))
