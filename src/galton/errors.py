"""How wrong arguments are told."""


class UsageError(ValueError):
    """A wrong argument: the message names it, its value and what would have been right."""


def require(condition: bool, message: str) -> None:
    """Raise UsageError with this message unless the condition holds."""
    if not condition:
        raise UsageError(message)
