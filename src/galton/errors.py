"""How wrong arguments are told."""

import numpy as np


class UsageError(ValueError):
    """A wrong argument: the message names it, its value and what would have been right."""


def require_integer(name: str, value: object, least: int) -> None:
    """Raise UsageError unless the value is an integer of at least `least`."""
    fits = isinstance(value, int | np.integer) and not isinstance(value, bool) and value >= least
    require(fits, f"{name} is {value}; it must be an integer of at least {least}")


def require(condition: bool | np.bool, message: str) -> None:
    """Raise UsageError with this message unless the condition holds."""
    if not condition:
        raise UsageError(message)
