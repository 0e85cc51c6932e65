"""A setting's annotation says what its value must be: the one check of every record of settings.

An annotation is bool, str, a Literal of words, a class, an integer or number with its bounds in an `Annotated`, a
tuple of any of them, or one of these or None.
"""

import contextlib
import functools
import types
from collections.abc import Callable, Iterable, Mapping, Set
from typing import Annotated, Any, Literal, NamedTuple, TypeVar, cast, get_args, get_origin, get_type_hints

import numpy as np
from jaxtyping import Bool, Float, Shaped

from galton.errors import UsageError, require, require_integer

CallableT = TypeVar("CallableT", bound=Callable[..., Any])
cached = cast("Callable[[CallableT], CallableT]", functools.cache)
"""functools.cache for functions of a class, which mypy takes for one without a hash where its objects have none."""


class AtLeast(NamedTuple):
    """The bound of an integer."""

    least: int


class Within(NamedTuple):
    """The bounds of a number, or of each number in an array."""

    holds: Callable[[Float[np.ndarray, "*runs"]], Bool[np.ndarray, "*runs"] | np.bool]
    wanted: str
    """The bounds in words."""


def checked(name: str, value: object, annotation: Any) -> Any:
    """The value, as a type of Python's own where that is what the annotation names.

    Numpy's booleans, integers and floats are as good as Python's; 0 and 1 are no booleans and True is no number.

    Raises:
        UsageError: it is not what the annotation says; the message has the name, the value and what would be right.
    """
    kind, details = get_origin(annotation), get_args(annotation)
    if kind is Annotated and isinstance(details[1], AtLeast):
        require_integer(name, value, details[1].least)
        return int(value)  # type: ignore[call-overload]
    if kind is Annotated and value is None and type(None) in get_args(details[0]):
        return None
    if kind is Annotated:
        _check_number(name, value, details[1])
        return value
    if kind is types.UnionType and types.NoneType in details:
        return None if value is None else checked(name, value, details[0])
    if kind is tuple:
        return tuple(checked(f"an entry of {name}", entry, details[0]) for entry in _entries(name, value))
    if kind is Literal:
        fits = isinstance(value, str) and value in details
        require(fits, f"{name} is {value!r}; choose from {', '.join(details)}")
        return value
    if annotation is bool:
        require(isinstance(value, bool | np.bool), f"{name} is {value!r}; it must be True or False")
        return bool(value)
    require(isinstance(value, annotation), f"{name} is {value!r}; it must be of type {annotation.__name__}")
    return value


@cached
def annotations(record: type) -> dict[str, Any]:
    """The annotation of each field of a record, with its bounds."""
    return get_type_hints(record, include_extras=True)


def as_numbers(name: str, value: object) -> Float[np.ndarray, "*shape"]:
    """A number, or an array or nested sequence of them, in float64; UsageError for anything else."""
    try:
        given: Shaped[np.ndarray, "*shape"] = np.asarray(float(value) if type(value) is int else value)
    except (TypeError, ValueError, OverflowError):
        given = np.asarray(None)
    if given.dtype.kind not in "fiu":
        raise UsageError(f"{name} is {value!r}; it must be a number")
    return given.astype(np.float64)


def _check_number(name: str, value: object, bounds: Within) -> None:
    given = as_numbers(name, value)
    with np.errstate(over="ignore"):
        right = np.asarray(bounds.holds(given.astype(np.float32)))  # what the programs compute with
    shown = given[~right].flat[0] if not right.all() else None
    require(shown is None, f"{name} is {shown}; it must be {bounds.wanted}")


def _entries(name: str, value: object) -> tuple[object, ...]:
    """The entries of a list, a tuple or anything else that has some in an order."""
    with contextlib.suppress(TypeError):  # an array without axes
        if isinstance(value, Iterable) and not isinstance(value, str | bytes | Mapping | Set):
            return tuple(value)
    raise UsageError(f"{name} is {value!r}; it must be a list or a tuple")
