"""One line of ours says that compiled programs can't be kept or read, instead of JAX's at each program."""

import glob
import os
import re
import sys
import warnings
from pathlib import Path
from typing import Any

from galton.training.programs_on_disk import PLACE, REMEDY, place

_SAID = re.compile(r"Error (reading|writing) persistent compilation cache entry for '([^']*)': (.*)", re.DOTALL)
"""JAX's warning that it can't use the folder, as a pattern: what failed, the program's name, and why."""


def keep_programs() -> None:
    """Have this command and its workers keep what they compile, unless the user says where JAX does, or PLACE is off.

    To be called before JAX is imported. A folder that can't be written is told, and nothing is kept.
    """
    try:
        folder = place()
    except (OSError, ValueError) as error:  # of a name with a character that none can have
        print(f"galton: compiled programs are not kept: {error}; {REMEDY}", file=sys.stderr)
        os.environ[PLACE] = "off"  # nobody tries again
        return
    if folder:
        tell_once(folder, REMEDY)
        os.environ["JAX_COMPILATION_CACHE_DIR"] = str(folder)
        os.environ.setdefault("JAX_PERSISTENT_CACHE_MIN_COMPILE_TIME_SECS", "0")


def tell_once(folder: Path, remedy: str) -> None:
    """Say once in a line what JAX warns of at each program; what could not be read is removed, so that it is kept anew.

    Worker processes say nothing.
    """
    before, told = warnings.showwarning, set[str]()

    def show(message: Warning | str, category: type[Warning], *where: Any, **others: Any) -> None:
        said = _SAID.match(str(message))
        if said is None:
            before(message, category, *where, **others)
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
