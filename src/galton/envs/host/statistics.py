"""Running statistics of wrappers: evaluation plays by those of training, and holds them still.

They are objects with mean, var, count and update, as those of a `NormalizeObservation`.
"""

import contextlib
import types
from collections.abc import Callable, Iterable, Iterator, Sequence
from typing import Any

import numpy as np
from jaxtyping import Float

from galton.envs.host.layers import Layers, below, is_sb3_wrapper
from galton.envs.host.state import put
from galton.errors import require

MOMENTS = ("mean", "var", "count")
"""The attributes of running statistics that are all of them."""

PREFIX = "statistics/"
"""The beginning of the names that a file has for them."""

AsGiven = Callable[[Float[np.ndarray, " M"]], Float[np.ndarray, " M"]]
"""A function of the rewards of a step of all copies."""

_MISSING = object()


def is_statistics(value: Any) -> bool:
    """True for running statistics, but not for a table, whose mean is a method."""
    has_all = all(hasattr(value, name) for name in (*MOMENTS, "update")) and hasattr(value, "__dict__")
    return has_all and not callable(value.mean)


def statistics_of(layers: Layers) -> dict[str, Any]:
    """The running statistics in the layers, by a name that tells place, wrapper and attribute."""
    found: dict[str, Any] = {}
    for i, layer in enumerate(layers):
        for name, value in vars(layer).items():
            each = {f".{key}": one for key, one in value.items()} if isinstance(value, dict) else {"": value}
            place = f"{i}/{type(layer).__name__}/{name}"
            found |= {place + key: one for key, one in each.items() if is_statistics(one)}
    return found


def of_observations(layers: Layers) -> dict[str, Any]:
    """The running statistics in the layers that observations are normalised by, by place."""
    found = statistics_of([layer for layer in layers if getattr(layer, "norm_obs", True)])  # SB3's VecNormalize may not
    return {place: one for place, one in found.items() if not _is_of_rewards(one)}


def set_moments(statistics: Any, moments: dict[str, Any]) -> None:
    """Give running statistics these moments."""
    for name, value in moments.items():
        put(statistics, name, value)


def statistics_in(arrays: dict[str, np.ndarray]) -> list[dict[str, Any]]:
    """The observations' statistics of each copy that a file of one run has, by place; nothing where it has none."""
    told = {name.removeprefix(PREFIX): of_run[0] for name, of_run in arrays.items() if name.startswith(PREFIX)}
    means = {name.rpartition("/")[0]: of_copies for name, of_copies in told.items() if name.endswith("/mean")}
    whole = [place for place in means if all(f"{place}/{m}" in told for m in MOMENTS)]
    places = [place for place in whole if means[place].ndim > 1]  # others are of rewards
    n = min((len(means[place]) for place in places), default=0)
    return [
        {place: types.SimpleNamespace(**{m: told[f"{place}/{m}"][i] for m in MOMENTS}) for place in places}
        for i in range(n)
    ]


def placed(arrays: dict[str, np.ndarray], like: dict[str, np.ndarray]) -> tuple[dict[str, np.ndarray], str]:
    """The statistics that a file of one run has for environments which have these, and what became of others.

    Wrapper and attribute say which are the same, and the order where there are several: with another wrapper around
    them they have another place.
    """
    there = {name.removeprefix(PREFIX): array for name, array in arrays.items() if name.startswith(PREFIX)}
    found: dict[str, np.ndarray] = {}
    for kind in {_kind(name): None for name in like}:
        own, theirs = ([name for name in names if _kind(name) == kind] for names in (like, there))
        if [like[name].shape for name in own] == [there[name].shape for name in theirs]:
            found |= {name: there.pop(other) for name, other in zip(own, theirs, strict=True)}
    new, lost = wrappers_at(like.keys() - found.keys()), wrappers_at(there)
    told = [f"there are no statistics for {new}"] * bool(new) + [f"the statistics of {lost} are lost"] * bool(lost)
    return found, " and ".join(told)


def _kind(name: str) -> str:
    """The wrapper, the attribute and the moment of a name, without its place."""
    return name.partition("/")[2]


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
def frozen(copies: Sequence[Layers]) -> Iterator[AsGiven]:
    """A time in which running statistics stay, and what `unscaled` gives."""
    with contextlib.ExitStack() as stack:
        for statistics in {id(one): one for layers in copies for one in statistics_of(layers).values()}.values():
            stack.enter_context(_replaced(statistics, "update", lambda *_, **__: None))
        yield stack.enter_context(unscaled(copies))


@contextlib.contextmanager
def unscaled(copies: Sequence[Layers]) -> Iterator[AsGiven]:
    """A time with a function that tells rewards as no statistics scale them.

    The function takes the rewards of a step of all copies. A reward that running statistics scale is told as it was
    below the innermost wrapper that does so; any other is what it is.
    """
    with contextlib.ExitStack() as stack:
        told: dict[int, np.ndarray] = {}

        def heard_from(layers: Layers) -> int | None:
            """The key in `told` of what last rewarded a copy, below all that scales rewards; None if nothing does."""
            scaling = scaling_rewards(layers)
            if not scaling:
                return None
            inner = below(scaling[-1])
            method = "step_wait" if is_sb3_wrapper(scaling[-1]) else "step"
            step = getattr(inner, method)

            def remembering(*arguments: Any) -> Any:
                answer = step(*arguments)
                told[id(inner)] = np.array(answer[1], np.float64).ravel()
                return answer

            if id(inner) not in told:
                told[id(inner)] = np.zeros(1)
                stack.enter_context(_replaced(inner, method, remembering))
            return id(inner)

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


def scaling_rewards(layers: Layers) -> Layers:
    """The layers that scale rewards by running statistics, from the outside in."""
    return [layer for layer in layers if any(map(_is_of_rewards, vars(layer).values()))]


def _is_of_rewards(value: Any) -> bool:
    """True for running statistics of one number, the return: those of observations have an axis."""
    return is_statistics(value) and np.ndim(value.mean) == 0


def wrappers_at(places: Iterable[str]) -> str:
    """The names of the wrappers at these places, each once."""
    return ", ".join(sorted(set(map(_readable, places))))


def _readable(place: str) -> str:
    return place.split("/")[1]


def _listed(statistics: dict[str, Any]) -> str:
    return ", ".join(map(_readable, statistics)) or "nothing"
