"""Libraries that only a part of Galton needs, other libraries' classes, and modules that somebody names.

An extra brings a library, and one message names both where it is missing.
"""

import contextlib
import importlib
import importlib.metadata
import importlib.util
import json
import re
import shlex
import sys
import urllib.parse
import urllib.request
from collections.abc import Iterable, Iterator
from pathlib import Path

from galton.errors import UsageError

LIBRARIES = {
    "pyarrow": "experiments",
    "matplotlib": "experiments",
    "jinja2": "experiments",
    "fsspec": "experiments",
    "mujoco": "mujoco",
    "imageio": "mujoco",
    "Box2D": "box2d",
    "imageio_ffmpeg": "video",
    "PIL": "video",
    "pygame": "video",
    "onnx": "onnx",
    "torch": "torch",
    "wandb": "wandb",
    "distributed": "cluster",
    "gymnax": "gymnax",
    "brax": "brax",
    "mujoco_playground": "playground",
    "mujoco.mjx": "mjx",
}
"""The extra of pyproject.toml that brings each library, which is known here by the name that one imports."""


class MissingExtraError(UsageError, ImportError):
    """A library of an extra is not installed: the message names both, and the command that installs it."""


def require_libraries(what: str, *libraries: str) -> None:
    """Raise MissingExtraError, which begins with `what`, unless all are installed; none is imported, to be quick."""
    missing = [library for library in libraries if not _is_there(library)]
    if missing:
        raise MissingExtraError(_told(what, missing))


@contextlib.contextmanager
def needed(what: str, *libraries: str) -> Iterator[None]:
    """Import libraries of an extra inside; MissingExtraError, which begins with `what`, where one can't be."""
    require_libraries(what, *libraries)
    try:
        yield
    except ImportError as error:
        raise MissingExtraError(f"{_told(what, libraries)} ({' '.join(str(error).split())})") from error


def check_named(what: str, error: BaseException) -> None:
    """Raise MissingExtraError, which begins with `what`, if another library's error names one that is lacking."""
    named = re.findall(r"\w+", str(error).lower())
    for library in LIBRARIES:
        if library.lower() in named:
            require_libraries(what, library)


def _is_there(library: str) -> bool:
    if library in sys.modules:
        return sys.modules[library] is not None
    with contextlib.suppress(ModuleNotFoundError):  # what it is a part of may be missing too
        return importlib.util.find_spec(library) is not None
    return False


def _told(what: str, libraries: list[str] | tuple[str, ...]) -> str:
    (extra,) = {LIBRARIES[library] for library in libraries}
    return f"{what} needs {' and '.join(libraries)}: {installing(extra)}"


def installing(extra: str) -> str:
    """The command that installs an extra: from the folder or the file that Galton came from, or else by its name."""
    try:
        told = json.loads(importlib.metadata.distribution("galton").read_text("direct_url.json") or "{}")
    except (importlib.metadata.PackageNotFoundError, ValueError):
        told = {}
    url = urllib.parse.urlsplit(told.get("url", ""))
    place = urllib.request.url2pathname(url.path)
    if url.scheme != "file" or not Path(place).exists():
        return f"pip install 'galton[{extra}]'"
    editable = "-e " if told.get("dir_info", {}).get("editable") else ""
    return f"pip install {editable}{shlex.quote(f'{place}[{extra}]')}"


def is_instance_of(value: object, package: str, name: str) -> bool:
    """True if a value's class, or one that it inherits from, has that name in that package; nothing is imported."""
    return any(cls.__name__ == name and cls.__module__.partition(".")[0] == package for cls in type(value).__mro__)


def import_all(modules: Iterable[str]) -> None:
    """Import modules that a study or a command names; UsageError for one that can't be imported."""
    for module in modules:
        try:
            importlib.import_module(module)
        except (ImportError, TypeError, ValueError) as error:
            remedy = "; a module is named without .py and its folder" if module.endswith(".py") else ""
            raise UsageError(f"imports names {module!r}, which can't be imported: {error}{remedy}") from None
