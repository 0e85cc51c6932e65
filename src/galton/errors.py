"""How wrong arguments are told."""

import numpy as np


class UsageError(ValueError):
    """A wrong argument: the message names it, its value and what would have been right."""


def require(condition: bool | np.bool, message: str) -> None:
    """Raise UsageError with this message unless the condition holds."""
    if not condition:
        raise UsageError(message)
