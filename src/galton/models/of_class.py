"""A class method that refuses to be called on an instance."""

import functools
from typing import TYPE_CHECKING, Any

from galton.errors import UsageError

if TYPE_CHECKING:
    of_class = classmethod
else:

    class of_class(classmethod):  # noqa: N801
        """A classmethod that makes an instance. Called on one it would leave that as it is, and so it refuses."""

        def __get__(self, instance, owner=None):
            """The method of the class; UsageError at a call of an instance's, with what to write."""
            method = super().__get__(instance, owner)
            return method if instance is None else functools.partial(_refuse_instance, instance, method)


def _refuse_instance(instance: object, method: Any, *_: object, **__: object) -> None:
    name = f"{type(instance).__name__}.{method.__name__}"
    raise UsageError(f"{name} makes a new model and leaves this one as it is; write model = {name}(path)")
