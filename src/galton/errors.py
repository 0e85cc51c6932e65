"""Errors and warnings by whose fault they are: an argument's, an environment's, a file's, or training's own."""

import difflib
import re
from collections.abc import Collection, Iterable

import numpy as np

MALFORMED = (LookupError, TypeError, ValueError, AttributeError, OverflowError, MemoryError, RecursionError)
"""The errors that come of settings and arrays which Galton did not write."""


class UsageError(ValueError):
    """A wrong argument: the message names it, its value and what would have been right."""


class BrokenEnvironmentError(RuntimeError):
    """An environment raised or returned what it must not: the message names the copy, the step and what came back."""


class CheckpointError(ValueError):
    """A file that is not a whole, unchanged checkpoint of Galton's."""


class NewerVersionError(UsageError):
    """A file that a newer version of Galton wrote: the message says what this one does not know in it."""


class DivergenceError(RuntimeError):
    """The gradient was not finite: the message names the step. The parameters before it are kept."""


class SharedEnvironment(UserWarning):
    """Somebody else reset or stepped an environment between two updates, so training begins a new episode there."""


class AliasedObservation(UserWarning):
    """A vector environment's episodes end with the next one's first observation, as where both are one array."""


class WideGaussian(UserWarning):
    """A Gaussian's σ, the same in every state, has outgrown the action box, and most of its actions are clipped."""


def require_integer(name: str, value: object, least: int) -> None:
    """Raise UsageError unless the value is an integer of at least `least`."""
    fits = isinstance(value, int | np.integer) and not isinstance(value, bool) and value >= least
    shown = value if isinstance(value, int | float | np.generic) else repr(value)
    require(fits, f"{name} is {shown}; it must be an integer of at least {least}")


def is_number(value: object) -> bool:
    """True for one number, Python's or numpy's; True and False are none."""
    return isinstance(value, int | float | np.integer | np.floating) and not isinstance(value, bool)


def require_word(name: str, value: object, choices: Collection[str]) -> None:
    """Raise UsageError, as `unknown` has it, unless the value is one of the choices."""
    if value not in choices:
        raise unknown(name, value, choices)


def require(condition: bool | np.bool, message: str) -> None:
    """Raise UsageError with this message unless the condition holds."""
    if not condition:
        raise UsageError(message)


def in_a_line(error: Exception) -> str:
    """The message of an error in one line; its type stands before what others than Galton raised."""
    said = str(error) if isinstance(error, UsageError | CheckpointError) else f"{type(error).__name__}: {error}"
    return " ".join(said.split())


def unknown(name: str, value: object, choices: Iterable[str]) -> UsageError:
    """The error for a word that is none of the choices; it lists them, and says which one was probably meant."""
    choices = tuple(choices)
    return UsageError(f"{name} is {value!r}; choose from {', '.join(choices)}{did_you_mean(value, choices)}")


def did_you_mean(word: object, choices: Iterable[str]) -> str:
    """A question for the end of a message, by likeness or initials; empty where nothing comes near."""
    known = {choice.strip("-").lower(): choice for choice in choices}
    plain = str(word).strip("-").lower().replace("_", "-")
    initials = [name for name in known if "".join(re.findall(r"\b[a-z]", name)) == plain]
    alike = initials or difflib.get_close_matches(plain, known, n=1, cutoff=0.65)
    return f"; did you mean {known[alike[0]]}?" if alike else ""
