"""Evaluation plays on copies that get what training's environments have learnt or been given.

A copy that is made anew lacks it: the statistics of a `NormalizeObservation`, the stage of a curriculum, a parameter
that somebody set since. It is found in the attributes of an environment and its wrappers, where they are plain data:
numbers, text, arrays, collections of them, and running statistics (objects with mean, var, count and update).
"""

import collections
import contextlib
import copy
import types
from collections.abc import Callable, Iterator, Sequence
from typing import Any, NamedTuple

import gymnasium
import numpy as np
from gymnasium.wrappers import TimeLimit
from jaxtyping import Float

from galton.envs.host.state import is_monitor, put
from galton.errors import UsageError, require
from galton.extras import is_instance_of

Layers = list[Any]
"""An environment's wrappers from the outside in, and the environment; of one in a vector environment, that's first."""
Attributes = list[dict[str, Any]]
"""The plain data in each of an environment's layers, by attribute."""


class Remembered(NamedTuple):
    """The plain data of layers at one moment."""

    values: Attributes
    """Copies, which stay as they are."""
    objects: Attributes
    """The attributes' own objects, which the environment may change."""


MOMENTS = ("mean", "var", "count")
"""The attributes of running statistics that are all of them."""

_MISSING = object()


def layers_of(env: Any) -> Layers:
    """The wrappers around an environment or a vector environment from the outside in, and what they are around."""
    found = [env]
    while isinstance(found[-1], gymnasium.Wrapper | gymnasium.vector.VectorWrapper) or _is_sb3_wrapper(found[-1]):
        found.append(_below(found[-1]))
    return [layer for layer in found if not is_monitor(layer)]


def layers_of_copies(envs: Any) -> list[Layers]:
    """For each copy in a vector environment of this process the layers that all share, and then its own."""
    shared = layers_of(envs)
    copies = copies_in(shared[-1])
    return [[*shared, *layers_of(one)] for one in copies] if copies else [shared] * envs.num_envs


def copies_in(envs: Any) -> list[gymnasium.Env[Any, Any]]:
    """The environments of this process that a vector environment holds as its `envs`; none where it holds no such."""
    found: Any = getattr(envs, "envs", None)
    own = isinstance(found, list | tuple) and all(isinstance(one, gymnasium.Env) for one in found)
    return list(found) if own else []


def has_no_limit(layers: Layers) -> bool:
    """True if an environment of this process has no time limit that Gymnasium knows of."""
    known = any(isinstance(layer, TimeLimit) for layer in layers)
    return isinstance(layers[-1], gymnasium.Env) and not known


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
    """The plain data in each layer that is not as it was before.

    An array that still is the same object, and shares its numbers with another attribute, belongs to the episode: a
    copy of it would be cut off from that attribute, and a reset that writes into one would not reach the other.
    """
    return [
        {
            name: value
            for name, value in now.items()
            if not _are_equal(value, values.get(name, _MISSING))
            and not (value is objects.get(name) and _is_shared(value, now))
        }
        for now, values, objects in zip(plain_data(layers), *before, strict=True)
    ]


def carry(trained: Layers, since: Attributes, layers: Layers) -> None:
    """Give a copy's layers all statistics that training's copy has, and copies of the plain data that changed there."""
    for layer, own, now in zip(layers, since, trained, strict=True):
        vars(layer).update(copy.deepcopy(own | {name: v for name, v in vars(now).items() if _is_statistics(v)}))
    go_on(layers, trained)


def go_on(layers: Layers, trained: Layers) -> None:
    """Let a copy go on, at its next reset with a seed, from what outlasts episodes in training's copy.

    Environments and wrappers that have such a thing have `go_on_from(other)`.
    """
    for layer, now in zip(layers, trained, strict=True):
        if callable(getattr(type(layer), "go_on_from", None)):
            layer.go_on_from(now)


def statistics_of(layers: Layers) -> dict[str, Any]:
    """The running statistics in the layers, by a name that tells place, wrapper and attribute."""
    found: dict[str, Any] = {}
    for i, layer in enumerate(layers):
        for name, value in vars(layer).items():
            each = {f".{key}": one for key, one in value.items()} if isinstance(value, dict) else {"": value}
            place = f"{i}/{type(layer).__name__}/{name}"
            found |= {place + key: one for key, one in each.items() if _is_statistics(one)}
    return found


def set_moments(statistics: Any, moments: dict[str, Any]) -> None:
    """Give running statistics these moments."""
    for name, value in moments.items():
        put(statistics, name, value)


def statistics_in(arrays: dict[str, np.ndarray]) -> list[dict[str, Any]]:
    """The observations' statistics of each copy that a file of one run has, by place; nothing where it has none."""
    prefix = "statistics/"
    told = {name.removeprefix(prefix): of_run[0] for name, of_run in arrays.items() if name.startswith(prefix)}
    means = {name.rpartition("/")[0]: of_copies for name, of_copies in told.items() if name.endswith("/mean")}
    whole = [place for place in means if all(f"{place}/{m}" in told for m in MOMENTS)]
    places = [place for place in whole if means[place].ndim > 1]  # others are of rewards
    n = min((len(means[place]) for place in places), default=0)
    return [
        {place: types.SimpleNamespace(**{m: told[f"{place}/{m}"][i] for m in MOMENTS}) for place in places}
        for i in range(n)
    ]


def take_statistics(name: str, layers: Layers, trained: dict[str, Any] | None) -> None:
    """Give an environment of the user's own the observations' statistics that training's has, one for one.

    Where nobody knows those, as of a file from before they were kept, it keeps its own. UsageError for others than
    training's, or for empty ones.
    """
    own = of_observations(layers)
    if trained is None:
        for place, statistics in own.items():
            require(
                statistics.count > 1,
                f"env is {name}, whose {_readable(place)} has counted no observations: the policy would see others "
                "than in training; load the model with its environment, load(path, env=...), or normalise by "
                "normalize_observation=True, whose statistics are the model's own",
            )
        return
    theirs = {place: trained[place] for place in own} if trained.keys() == own.keys() else trained
    shapes = [[np.shape(one.mean) for one in each.values()] for each in (own, theirs)]
    require(
        shapes[0] == shapes[1],
        f"env is {name}, which normalises observations by {_listed(own)}, and what the model is trained on by "
        f"{_listed(theirs)}: the policy would see others than in training; wrap both alike",
    )
    for statistics, others in zip(own.values(), theirs.values(), strict=True):
        set_moments(statistics, {name: getattr(others, name) for name in MOMENTS})


@contextlib.contextmanager
def frozen(copies: Sequence[Layers]) -> Iterator[Callable[[Float[np.ndarray, " M"]], Float[np.ndarray, " M"]]]:
    """A time in which running statistics stay, and a function that tells rewards as no statistics scale them.

    The function takes the rewards of a step of all copies. A reward that running statistics scale is told as it was
    below the innermost wrapper that does so; any other is what it is.
    """
    with contextlib.ExitStack() as stack:
        for statistics in {id(one): one for layers in copies for one in statistics_of(layers).values()}.values():
            stack.enter_context(_replaced(statistics, "update", lambda *_, **__: None))
        told: dict[int, np.ndarray] = {}

        def heard_from(layers: Layers) -> int | None:
            """The key in `told` of what last rewarded a copy, below all that scales rewards; None if nothing does."""
            scaling = [layer for layer in layers if any(map(_is_of_rewards, vars(layer).values()))]
            if not scaling:
                return None
            below = _below(scaling[-1])
            method = "step_wait" if _is_sb3_wrapper(scaling[-1]) else "step"
            step = getattr(below, method)

            def remembering(*arguments: Any) -> Any:
                answer = step(*arguments)
                told[id(below)] = np.array(answer[1], np.float64).ravel()
                return answer

            if id(below) not in told:
                told[id(below)] = np.zeros(1)
                stack.enter_context(_replaced(below, method, remembering))
            return id(below)

        heard = [heard_from(layers) for layers in copies]

        def as_given(rewards: Float[np.ndarray, " M"]) -> Float[np.ndarray, " M"]:
            own = [rewards[i] if key is None else told[key][i % len(told[key])] for i, key in enumerate(heard)]
            return np.array(own, np.float64)

        yield as_given if told else lambda rewards: rewards


@contextlib.contextmanager
def _replaced(holder: Any, name: str, value: Any) -> Iterator[None]:
    """A time in which an object has another attribute of its own."""
    before = vars(holder).get(name, _MISSING)
    vars(holder)[name] = value
    try:
        yield
    finally:
        if before is _MISSING:
            del vars(holder)[name]
        else:
            vars(holder)[name] = before


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
    return value is None or isinstance(value, bool | int | float | str | np.generic) or _is_statistics(value)


def _is_shared(value: Any, among: dict[str, Any]) -> bool:
    """True for an array that is a view, that has one among these attributes, or that is two of them."""
    if not isinstance(value, np.ndarray):
        return False
    holders = [other is value or (isinstance(other, np.ndarray) and other.base is value) for other in among.values()]
    return value.base is not None or sum(holders) > 1


def _is_statistics(value: Any) -> bool:
    return all(hasattr(value, name) for name in (*MOMENTS, "update")) and hasattr(value, "__dict__")


def _is_of_rewards(value: Any) -> bool:
    """True for running statistics of one number, the return: those of observations have an axis."""
    return _is_statistics(value) and np.ndim(value.mean) == 0


def of_observations(layers: Layers) -> dict[str, Any]:
    """The running statistics in the layers that observations are normalised by, by place."""
    found = statistics_of([layer for layer in layers if getattr(layer, "norm_obs", True)])  # SB3's VecNormalize may not
    return {place: one for place, one in found.items() if not _is_of_rewards(one)}


def _are_equal(one: Any, other: Any) -> bool:
    if _is_statistics(one) and _is_statistics(other):
        return all(_are_equal(getattr(one, name), getattr(other, name)) for name in MOMENTS)
    if isinstance(one, list | tuple | collections.deque) and type(one) is type(other):
        return len(one) == len(other) and all(map(_are_equal, one, other))
    if isinstance(one, dict) and isinstance(other, dict):
        return one.keys() == other.keys() and all(_are_equal(value, other[key]) for key, value in one.items())
    arrays = isinstance(one, np.ndarray | float) and isinstance(other, np.ndarray | float)
    if arrays and np.asarray(one).dtype.kind in "fc":
        return np.array_equal(one, other, equal_nan=True)
    if type(one) is not type(other):
        return False
    return np.array_equal(one, other) if isinstance(one, np.ndarray) else bool(one == other)


def _is_sb3_wrapper(env: Any) -> bool:
    return is_instance_of(env, "stable_baselines3", "VecEnvWrapper")


def _below(wrapper: Any) -> Any:
    return wrapper.venv if _is_sb3_wrapper(wrapper) else wrapper.env


def _readable(place: str) -> str:
    return place.split("/")[1]


def _listed(statistics: dict[str, Any]) -> str:
    return ", ".join(map(_readable, statistics)) or "nothing"
