"""Gymnasium's action spaces as the flat vectors that policies act in: numbers in a box, and choices."""

import dataclasses
import functools
from typing import Any

import jax
import numpy as np
from gymnasium.spaces import Box, Dict, Discrete, MultiBinary, MultiDiscrete, Tuple
from jaxtyping import Float

from galton import parts
from galton.bins import Bins
from galton.envs.host.base import Space
from galton.errors import UsageError, is_number, require

LEAST_SPAN = 1e-30
"""Of an action dimension: bins of a narrower one would underflow."""
MOST_VALUES = 65_536
"""Of all choices together: the network has an output for each value."""


@dataclasses.dataclass(frozen=True)
class Actions:
    """A checked action space, in units of its own; UsageError for one that Galton can't act in.

    Policies see a vector: the entries of each Box, in its own order, and for each choice the index of its value.
    A number whose bounds are equal counts as a choice of one value.
    """

    name: str
    own: Any
    """The environment's own space."""
    scale: float = 1.0
    """The factor by which a policy's action is larger than the environment's. By a power of two, floating point changes
    no bit but the exponent: a policy that is told its box alone must then learn the same."""
    n_mask: int = 0
    """The entries of the masks that the environment tells."""

    def __post_init__(self) -> None:
        fits = is_number(self.scale) and 0 < self.scale < float("inf")
        require(fits, f"action_scale is {self.scale!r}; it must be a finite number greater than 0")
        for keys, leaf in leaves(self.own):
            place = "".join(f"[{key!r}]" for key in keys)
            about = f"{self.name} has actions {self.own}" + (f"; {place}" if place else "")
            _check_kind(about, leaf)
            if isinstance(leaf, Box):
                _check_bounds(about, leaf)
                _check_float32(about, _scaled(leaf, self.scale))
        require(
            self.scale == 1 or isinstance(self.own, Box),
            f"action_scale is {self.scale:g}; it goes with a Box, and {self.name} has actions {self.own}",
        )
        actions = f"{self.name} has actions {self.own}"
        n_entries = sum(len(entries(leaf)[0]) for _, leaf in leaves(self.own))
        require(n_entries > 0, f"{actions}, which are none; give them one entry at least")
        n_values = sum(self.box.n_values)
        require(
            n_values <= MOST_VALUES,
            f"{actions}, {n_values:,} values in all, and a softmax over more than {MOST_VALUES:,} is too large; wrap "
            "the environment so that it takes several smaller choices, a MultiDiscrete, or a number, a Box "
            "(gymnasium.wrappers.TransformAction)",
        )

    @functools.cached_property
    def space(self) -> Any:
        """The space that policies act in."""
        return _scaled(self.own, self.scale)

    @property
    def low(self) -> Float[np.ndarray, " d"]:
        """The lower bounds, flat and in float32."""
        return np.array(self.box.low, np.float32)

    @property
    def high(self) -> Float[np.ndarray, " d"]:
        """The upper bounds, flat and in float32."""
        return np.array(self.box.high, np.float32)

    @functools.cached_property
    def box(self) -> parts.Box:
        """The vector's bounds and choices, as an agent knows them."""
        each = [entries(leaf) for _, leaf in leaves(self.space)]
        low, high, n_values = (np.concatenate(rows) for rows in zip(*each, strict=True))
        names = [
            ".".join(map(str, (*keys, i)))
            for (keys, _), rows in zip(leaves(self.space), each, strict=True)
            for i in range(len(rows[0]))
        ]
        named = tuple(names) if isinstance(self.space, Dict | Tuple) else ()
        found = parts.Box.of(low, high, tuple(map(int, n_values)))
        return found._replace(n_mask=self.n_mask, names=named)

    def clip(self, action: Float[np.ndarray, "*batch d"]) -> Any:
        """A policy's actions as the space has them, numbers clipped into the exact bounds; copies."""
        return _taken(self.space, np.asarray(action))

    def to_env(self, action: Float[np.ndarray | jax.Array, "*batch d"]) -> Any:
        """The environment's own actions: numbers over the scale, clipped into its own bounds, in its own precision.

        Inside of a program integers are int32.
        """
        return _taken(self.own, action if self.scale == 1 else action / np.float32(self.scale))

    def one(self, actions: Any, i: int) -> Any:
        """The i-th of a batch that `clip` or `to_env` gave; a Discrete's is an int."""
        return _one(self.own, actions, i)


def _scaled(space: Any, scale: float) -> Any:
    if scale == 1:
        return space
    kind = np.promote_types(space.dtype, np.float32)
    low, high = (bound.astype(kind) * np.float32(scale) for bound in (space.low, space.high))
    return Box(low, high, dtype=kind.type)


def leaves(space: Any, keys: tuple[Any, ...] = ()) -> list[tuple[tuple[Any, ...], Any]]:
    """The spaces without parts of their own that a space is made of, each with the keys that lead to it."""
    if not isinstance(space, Dict | Tuple):
        return [(keys, space)]
    inside = space.spaces.items() if isinstance(space, Dict) else enumerate(space.spaces)
    return [leaf for key, part in inside for leaf in leaves(part, (*keys, key))]


def entries(space: Space) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """The lower and upper bounds of a leaf's entries, and the number of values of those that are choices, else 0."""
    if isinstance(space, Box):
        low, high = (bound.astype(np.float32).ravel() for bound in (space.low, space.high))
        return low, high, (low == high).astype(int)
    counts = (
        np.full(space.shape, 2) if isinstance(space, MultiBinary) else getattr(space, "nvec", getattr(space, "n", 0))
    )
    counts = np.ravel(counts).astype(int)
    return np.zeros(len(counts), np.float32), (counts - 1).astype(np.float32), counts


def _taken(space: Any, rows: Any) -> Any:
    """The space's own actions of rows of entries; JAX's arrays of JAX's."""
    if isinstance(space, Box):
        return _clipped(rows, space)
    if isinstance(space, Dict | Tuple):
        inside = list(space.spaces.values() if isinstance(space, Dict) else space.spaces)
        sizes = [sum(len(entries(leaf)[0]) for _, leaf in leaves(part)) for part in inside]
        places = zip(inside, np.cumsum([0, *sizes]), sizes, strict=False)
        found = [_taken(part, rows[..., start : start + size]) for part, start, size in places]
        return dict(zip(space.spaces, found, strict=True)) if isinstance(space, Dict) else tuple(found)
    xp: Any = jax.numpy if isinstance(rows, jax.Array) else np
    index = xp.rint(rows).astype(xp.int32 if xp is jax.numpy else space.dtype)
    if isinstance(space, MultiBinary):
        return index.reshape((*rows.shape[:-1], *space.shape))
    if isinstance(space, Discrete):
        return index[..., 0] + index.dtype.type(space.start)
    return index.reshape((*rows.shape[:-1], *space.shape)) + xp.asarray(space.start, index.dtype)


def _one(space: Any, actions: Any, i: int) -> Any:
    if isinstance(space, Dict):
        return {key: _one(part, actions[key], i) for key, part in space.spaces.items()}
    if isinstance(space, Tuple):
        return tuple(_one(part, own, i) for part, own in zip(space.spaces, actions, strict=True))
    return int(actions[i]) if isinstance(space, Discrete) else actions[i, ...]


def _clipped(action: Any, space: Box) -> Any:
    shape = (*action.shape[:-1], *space.shape)
    if isinstance(action, jax.Array):
        return jax.numpy.clip(action.reshape(shape), space.low, space.high)
    with np.errstate(over="ignore"):  # the bounds take care of it
        shaped = action.reshape(shape).astype(space.dtype)
    return np.asarray(np.minimum(np.maximum(shaped, space.low), space.high))


def _check_float32(actions: str, space: Box) -> None:
    low, high = (bound.astype(np.float64) for bound in (space.low, space.high))
    spans = high - low
    require(
        (abs(np.stack([low, high, spans])) <= np.finfo(np.float32).max).all(),
        f"{actions}, which is too large for float32; wrap the environment so that it takes smaller actions "
        "(gymnasium.wrappers.RescaleAction)",
    )
    narrow = f"{actions}, which is too narrow for float32; wrap the environment so that it takes larger actions "
    moving = spans > 0
    rounded = [bound.astype(np.float32)[moving] for bound in (low, high)]
    require(
        (spans[moving] > LEAST_SPAN).all() and (rounded[0] < rounded[1]).all(),
        f"{narrow}(gymnasium.wrappers.RescaleAction)",
    )
    try:
        Bins(rounded[0], rounded[1], 2)
    except UsageError as error:
        raise UsageError(f"{actions}: {error}") from None


def _check_kind(actions: str, space: object) -> None:
    if not isinstance(space, Box | Discrete | MultiDiscrete | MultiBinary):
        raise UsageError(
            f"{actions} of {type(space).__name__}; Galton acts in Box, Discrete, MultiDiscrete and MultiBinary, and in "
            "Dict and Tuple of them. Wrap the environment so that it takes one (gymnasium.wrappers.TransformAction)"
        )
    require(
        not isinstance(space, Box) or space.dtype.kind == "f",
        f"{actions}, whose type is {space.dtype}; a Box must be of floating-point numbers. Wrap the environment so "
        "that it takes a MultiDiscrete, or a Box that it rounds (gymnasium.wrappers.TransformAction)",
    )


def _check_bounds(actions: str, space: Box) -> None:
    remedy = "Give it finite bounds: gymnasium.wrappers.TransformAction(env, lambda action: action, Box(low, high))"
    for bound, side in ((space.low, "low"), (space.high, "high")):
        for problem, where in (("not a number", np.isnan(bound)), ("unbounded", np.isinf(bound))):
            if where.any():
                raise UsageError(f"{actions}; {side} is {problem} at {_first(where)}, and bins need an end. {remedy}")
    empty = space.low > space.high
    if empty.any():
        raise UsageError(f"{actions}; low must not lie above high, as at {_first(empty)}")


def _first(where: np.ndarray | np.bool) -> str:
    """The index of the first entry that is True, as it is written in Python."""
    return f"[{', '.join(map(str, np.argwhere(where)[0]))}]"
