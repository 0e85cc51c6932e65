"""The answers of environments are checked here: a BrokenEnvironmentError says where, and what came back.

`where` begins each message: the environment, the copy and the step.
"""

import contextlib
import warnings
from collections.abc import Callable, Iterator
from typing import Any, TypeVar

import numpy as np
from jaxtyping import Float, Shaped

from galton.envs.host.mujoco_log import mujoco_warns
from galton.errors import BrokenEnvironmentError, UsageError

FAULTS = (Exception, SystemExit)
"""The exceptions that are an environment's own fault: one that calls sys.exit() must not end training in silence."""
Made = TypeVar("Made")

LARGEST = float(np.finfo(np.float32).max)


@contextlib.contextmanager
def blame(where: str) -> Iterator[None]:
    """Turn whatever is raised inside into a BrokenEnvironmentError that begins with `where`."""
    try:
        yield
    except FAULTS as error:
        raise BrokenEnvironmentError(f"{where} raised {told(error)}") from error


def try_to_make(name: str, make: Callable[[], Made]) -> Made:
    """The environment of that name that `make` makes; a UsageError says why it can't."""
    try:
        with mujoco_warns(), warnings.catch_warnings():
            # Box2D warns of itself while it is imported, and ends the process where warnings are errors.
            warnings.filterwarnings("ignore", "builtin type", DeprecationWarning)
            return make()
    except FAULTS as error:
        raise UsageError(f"environment is {name!r}, which can't be made: {told(error)}") from error


def told(error: BaseException) -> str:
    """An error's type and, where it has one, its message."""
    return f"{type(error).__name__}: {error}" if str(error) else type(error).__name__


def shown(value: object) -> str:
    """A value in an error message, cut short."""
    try:
        text = " ".join(repr(value).split())
    except Exception:
        text = f"a {type(value).__name__} that can't be shown"
    described = f" of shape {value.shape}" if isinstance(value, np.ndarray) else ""
    return (text if len(text) <= 120 else f"{text[:117]}...") + described


def parts(answer: object, names: str, method: str, where: str) -> tuple[Any, ...]:
    """The answer of a method that must be a tuple with as many parts as there are names."""
    if isinstance(answer, tuple) and len(answer) == names.count(",") + 1:
        return answer
    raise BrokenEnvironmentError(f"{where}: {method} returned {shown(answer)}; it must return ({names})")


def one_number(value: object, what: str, where: str) -> float:
    """A number that float32 can hold."""
    if isinstance(value, float) and -LARGEST <= value <= LARGEST:  # np.float64 is one; NaN is not between
        return value
    number = as_numbers(value)
    if number is None or number.size != 1:
        raise BrokenEnvironmentError(f"{where}: {what} is {shown(value)}; it must be one number")
    return float(as_float32(number.reshape(()), what, where))


def one_flag(value: object, what: str, where: str) -> bool:
    """True or False, which may come as numpy's, or as the integer 1 or 0."""
    if value is True or value is False:
        return value
    scalar = value[()] if isinstance(value, np.ndarray) and value.shape == () else value
    if not isinstance(scalar, bool | np.bool) and not (isinstance(scalar, int | np.integer) and scalar in (0, 1)):
        raise BrokenEnvironmentError(f"{where}: {what} is {shown(value)}; it must be True or False")
    return bool(scalar)


def as_numbers(raw: object) -> Shaped[np.ndarray, "..."] | None:
    """The array of what an environment returned; None if it isn't one of real numbers."""
    try:
        values = np.asarray(raw)
    except Exception:  # anything may come, even with an __array__ that fails
        return None
    return values if values.dtype.kind in "fiub" else None


def as_float32(values: np.ndarray, what: str, where: str) -> Float[np.ndarray, "..."]:
    """The same numbers in float32, copied; BrokenEnvironmentError if one of them is not finite."""
    with np.errstate(over="ignore", invalid="ignore"):
        converted = values.astype(np.float32)
    finite = np.isfinite(converted)
    if not finite.all():
        index = np.argwhere(~finite)[0]
        value = values[tuple(index)]
        kind = "too large for float32" if np.isfinite(value) else "not finite"
        place = f"entry [{', '.join(map(str, index))}] of {what}" if len(index) else what
        raise BrokenEnvironmentError(f"{where}: {place} is {value}, which is {kind}")
    return converted
