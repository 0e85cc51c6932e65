"""A file was made by these: the versions, the machine and the commit."""

import functools
import importlib.metadata
import platform
import subprocess
from pathlib import Path

from galton.version import __version__

PACKAGES = ("galton", "jax", "jaxlib", "numpy", "optax", "gymnasium", "mujoco")
"""The packages that results depend on."""


@functools.cache
def versions(*more: str) -> dict[str, str | None]:
    """The versions of PACKAGES, of `more` and of Python, None where there is no such package; and the commit."""
    found = {name: version(name) for name in (*PACKAGES, *more)}
    return found | {"commit": commit(), "python": platform.python_version()}


def version(package: str = "galton") -> str | None:
    """The version of Galton or of an installed package, if it is one."""
    if package == "galton":
        return __version__
    try:
        return importlib.metadata.version(package)
    except importlib.metadata.PackageNotFoundError:
        return None


def machine() -> str:
    """The name of this machine, its architecture and its system."""
    return f"{platform.node()} {platform.machine()} {platform.platform()}"


def commit() -> str | None:
    """The commit of the checkout that this file belongs to, if it belongs to one."""

    def git(*command: str) -> str:
        here = Path(__file__).parent
        line = ["git", *command]  # no shell, words of our own, and the git that the user has
        done = subprocess.run(line, cwd=here, capture_output=True, text=True, check=True, timeout=10)  # noqa: S603
        return done.stdout.strip()

    try:
        git("ls-files", "--error-unmatch", Path(__file__).name)  # it may lie in somebody else's
        return git("describe", "--always", "--dirty", "--abbrev=12")
    except (OSError, subprocess.SubprocessError):
        return None
