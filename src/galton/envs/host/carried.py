"""Evaluation plays on copies that get what training's environments have learnt or been given.

A copy that is made anew lacks it: the statistics of a `NormalizeObservation`, the stage of a curriculum, a parameter
that somebody set since. It is found in the attributes of an environment and its wrappers, where they are plain data:
numbers, text, arrays, collections of them, and running statistics (objects with mean, var, count and update).
"""

import collections
import copy
from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

from galton.envs.host.layers import Layers
from galton.envs.host.statistics import MOMENTS, is_statistics
from galton.errors import UsageError, require

Attributes = list[dict[str, Any]]
"""The plain data in each of an environment's layers, by attribute."""

_MISSING = object()


class Remembered(NamedTuple):
    """The plain data of layers at one moment."""

    values: Attributes
    """Copies, which stay as they are."""
    objects: Attributes
    """The attributes' own objects, which the environment may change."""


def plain_data(layers: Layers) -> Attributes:
    """The plain data in each layer, by attribute; what records or shows episodes has none."""
    return [
        {name: value for name, value in vars(layer).items() if _is_plain(value)}
        if type(layer).__module__ != "gymnasium.wrappers.rendering"
        else {}
        for layer in layers
    ]


def remember(copies: Sequence[Layers]) -> list[Remembered]:
    """The plain data of each copy now; what several hold is kept once."""
    known: dict[int, Any] = {}
    found = [plain_data(layers) for layers in copies]
    return [Remembered(copy.deepcopy(each, known), each) for each in found]


def changed(layers: Layers, before: Remembered) -> Attributes:
    """The plain data in each layer that is not as it was before."""
    return [
        {name: value for name, value in now.items() if not _are_equal(value, values.get(name, _MISSING))}
        for now, values in zip(plain_data(layers), before.values, strict=True)
    ]


def beside(layers: Layers, other: Remembered) -> Remembered:
    """The plain data of a copy now; what is as another's was, such as data that both read, is kept once."""
    own = copy.deepcopy(changed(layers, other))
    return Remembered([theirs | mine for theirs, mine in zip(other.values, own, strict=True)], plain_data(layers))


def carry(trained: Layers, at_first: Remembered, layers: Layers, begun: Remembered) -> None:
    """Give a copy's layers all statistics that training's copy has, and its plain data that changed there or here.

    Both are remembered after their first reset. An array that neither has exchanged for another is written into, since
    other objects may hold it too.
    """
    since, objects = (changed(trained, at_first), changed(layers, begun)), (at_first.objects, begun.objects)
    for layer, now, there, own, firsts, own_firsts in zip(layers, plain_data(trained), *since, *objects, strict=True):
        here = vars(layer)
        given, written = dict[str, Any](), dict[int, Any]()
        for name, value in now.items():
            if not (name in there or name in own or is_statistics(value)):
                continue
            array = here.get(name, _MISSING)
            if value is firsts.get(name) and array is own_firsts.get(name) and _can_take(array, value):
                array[...] = value
                written[id(value)] = array
            else:
                given[name] = value
        here.update(copy.deepcopy(given, written))  # a list with an array that was written into gets that array
    go_on(layers, trained)


def go_on(layers: Layers, trained: Layers) -> None:
    """Let a copy go on, at its next reset with a seed, from what outlasts episodes in training's copy.

    Environments and wrappers that have such a thing have `go_on_from(other)`.
    """
    for layer, now in zip(layers, trained, strict=True):
        if callable(getattr(type(layer), "go_on_from", None)):
            layer.go_on_from(now)


def refuse_different(name: str, given: Layers, as_given: Remembered, anew: Layers) -> None:
    """Raise UsageError where an environment that is made anew is not like the one that was given.

    What training has changed in the given one since does not count: it is carried to each copy.
    """
    kinds = [[type(layer).__name__ for layer in layers] for layers in (given, anew)]
    remedy = "give a function that makes it, or evaluate on another: evaluate(env=...) or Evaluate(env=...)"
    require(
        kinds[0] == kinds[1],
        f"{name} is {' in '.join(reversed(kinds[0]))}, and its spec makes {' in '.join(reversed(kinds[1]))}: {remedy}",
    )
    since = changed(given, as_given)
    made = remember([anew])[0].values
    anew[0].reset(seed=0)
    begun = plain_data(anew)
    for layer, own, moved, *likes in zip(given, as_given.values, since, made, begun, strict=True):
        if type(layer).__module__.startswith("gymnasium.wrappers"):
            continue
        for attribute, value in own.items():
            there = [like[attribute] for like in likes if attribute in like]
            if attribute in moved or not there or any(_are_equal(value, other) for other in there):
                continue
            raise UsageError(
                f"{name}'s {attribute} is {value!r:.60}, but {there[0]!r:.60} in one that its spec makes, so "
                f"evaluation can't have copies of it; {remedy}"
            )


def _is_plain(value: Any, depth: int = 3) -> bool:
    if isinstance(value, np.ndarray):
        return value.dtype != object
    if isinstance(value, list | tuple | collections.deque):
        return depth > 0 and all(_is_plain(one, depth - 1) for one in value)
    if isinstance(value, dict):
        return depth > 0 and all(_is_plain(one, depth - 1) for one in (*value.keys(), *value.values()))
    return value is None or isinstance(value, bool | int | float | str | np.generic) or is_statistics(value)


def _can_take(array: Any, value: Any) -> bool:
    """True for an array in which another's numbers can be written."""
    both = isinstance(array, np.ndarray) and isinstance(value, np.ndarray)
    return both and array.flags.writeable and (array.shape, array.dtype) == (value.shape, value.dtype)


def _are_equal(one: Any, other: Any) -> bool:
    if is_statistics(one) and is_statistics(other):
        return all(_are_equal(getattr(one, name), getattr(other, name)) for name in MOMENTS)
    if isinstance(one, list | tuple | collections.deque) and type(one) is type(other):
        return len(one) == len(other) and all(map(_are_equal, one, other))
    if isinstance(one, dict) and isinstance(other, dict):
        return one.keys() == other.keys() and all(_are_equal(value, other[key]) for key, value in one.items())
    arrays = isinstance(one, np.ndarray | float) and isinstance(other, np.ndarray | float)
    if arrays and np.asarray(one).dtype.kind in "fc":
        # The first takes an eighth of the time, and mostly it is all that is asked.
        return np.array_equal(one, other) or np.array_equal(one, other, equal_nan=True)
    if type(one) is not type(other):
        return False
    return np.array_equal(one, other) if isinstance(one, np.ndarray) else bool(one == other)
