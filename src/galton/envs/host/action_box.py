"""Gymnasium's action spaces as the boxes that policies act in."""

import dataclasses
import functools
from typing import Any

import numpy as np
from gymnasium.spaces import Box
from jaxtyping import Float

from galton import parts
from galton.bins import Bins
from galton.errors import UsageError, require

LEAST_SPAN = 1e-30
"""Of an action dimension: bins of a narrower one would underflow."""


@dataclasses.dataclass(frozen=True)
class ActionBox:
    """A checked action space, in units of its own; UsageError for one that isn't a Box with finite bounds."""

    name: str
    own: Any
    """The environment's own space."""
    scale: float = 1.0
    """The factor by which a policy's action is larger than the environment's. By a power of two, floating point changes
    no bit but the exponent: a policy that is told its box alone must then learn the same."""

    def __post_init__(self) -> None:
        _check_kind(f"{self.name} has actions {self.own}", self.own)
        actions = f"{self.name} has actions {self.space}"
        _check_bounds(actions, self.space)
        self._check_float32(actions)
        try:
            Bins(self.low, self.high, 2)
        except UsageError as error:
            raise UsageError(f"{actions}: {error}") from None

    @functools.cached_property
    def space(self) -> Any:
        """The box that policies see."""
        if self.scale == 1:
            return self.own
        kind = np.promote_types(self.own.dtype, np.float32)
        low, high = (bound.astype(kind) * np.float32(self.scale) for bound in (self.own.low, self.own.high))
        return Box(low, high, dtype=kind.type)

    @property
    def low(self) -> Float[np.ndarray, " d"]:
        """The lower bounds, flat and in float32."""
        return self.space.low.astype(np.float32).ravel()

    @property
    def high(self) -> Float[np.ndarray, " d"]:
        """The upper bounds, flat and in float32."""
        return self.space.high.astype(np.float32).ravel()

    @property
    def box(self) -> parts.Box:
        """The bounds as an agent knows them."""
        return parts.Box.of(self.low, self.high)

    def clip(self, action: Float[np.ndarray, "*batch d"]) -> np.ndarray:
        """A policy's action, clipped into the exact bounds, in the space's shape and precision; a copy."""
        return _clipped(action, self.space)

    def to_env(self, action: Float[np.ndarray, "*batch d"]) -> np.ndarray:
        """The environment takes the action over the scale, clipped into its own bounds, in its own precision."""
        return _clipped(action if self.scale == 1 else action / np.float32(self.scale), self.own)

    def _check_float32(self, actions: str) -> None:
        low, high = self.space.low, self.space.high
        spans = high.astype(np.float64) - low.astype(np.float64)
        require(
            (abs(np.stack([low, high, spans])) <= np.finfo(np.float32).max).all(),
            f"{actions}, which is too large for float32; wrap the environment so that it takes smaller actions "
            "(gymnasium.wrappers.RescaleAction)",
        )
        require(
            (spans > LEAST_SPAN).all() and (self.low < self.high).all(),
            f"{actions}, which is too narrow for float32; wrap the environment so that it takes larger actions "
            "(gymnasium.wrappers.RescaleAction)",
        )


def _clipped(action: Float[np.ndarray, "*batch d"], space: Box) -> np.ndarray:
    with np.errstate(over="ignore"):  # the bounds take care of it
        shaped = action.reshape((*action.shape[:-1], *space.shape)).astype(space.dtype)
    return np.asarray(np.minimum(np.maximum(shaped, space.low), space.high))


def _check_kind(actions: str, space: object) -> None:
    if not isinstance(space, Box):
        raise UsageError(
            f"{actions}; Galton is for continuous actions and needs a Box. Wrap the environment so that it takes one "
            "(gymnasium.wrappers.TransformAction)"
        )
    require(
        space.dtype.kind == "f",
        f"{actions}, whose type is {space.dtype}; Galton needs a Box of floating-point numbers. Wrap the "
        "environment so that it takes one and rounds (gymnasium.wrappers.TransformAction)",
    )
    require(np.prod(space.shape) > 0, f"{actions}, a box without dimensions; give it one at least")


def _check_bounds(actions: str, space: Box) -> None:
    remedy = "Give it finite bounds: gymnasium.wrappers.TransformAction(env, lambda action: action, Box(low, high))"
    for bound, side in ((space.low, "low"), (space.high, "high")):
        for problem, where in (("not a number", np.isnan(bound)), ("unbounded", np.isinf(bound))):
            if where.any():
                raise UsageError(f"{actions}; {side} is {problem} at {_first(where)}, and bins need an end. {remedy}")
    empty = space.low >= space.high
    if empty.any():
        raise UsageError(f"{actions}; low must lie below high at {_first(empty)}. Leave that dimension out or widen it")


def _first(where: np.ndarray | np.bool) -> str:
    """The index of the first entry that is True, as it is written in Python."""
    return f"[{', '.join(map(str, np.argwhere(where)[0]))}]"
