"""What Galton does not import by itself: other libraries' classes, told by name, and modules that somebody names."""

import importlib
from collections.abc import Iterable

from galton.errors import UsageError


def is_instance_of(value: object, package: str, name: str) -> bool:
    """Whether a value's class, or one that it inherits from, has that name in that package; nothing is imported."""
    return any(cls.__name__ == name and cls.__module__.partition(".")[0] == package for cls in type(value).__mro__)


def import_all(modules: Iterable[str]) -> None:
    """Import modules that a study or a command names; UsageError for one that can't be imported."""
    for module in modules:
        try:
            importlib.import_module(module)
        except (ImportError, TypeError, ValueError) as error:
            raise UsageError(f"imports names {module!r}, which can't be imported: {error}") from None
