"""Gymnasium's action spaces as the boxes that policies act in."""

import dataclasses
from typing import Any

import numpy as np
from gymnasium.spaces import Box
from jaxtyping import Float

from galton.bins import Bins
from galton.errors import UsageError, require

LEAST_SPAN = 1e-30
"""Of an action dimension: bins of a narrower one would underflow."""


@dataclasses.dataclass(frozen=True)
class ActionBox:
    """A checked action space.

    Raises:
        UsageError: a space that isn't a Box with finite bounds in every dimension.
    """

    name: str
    space: Any

    def __post_init__(self) -> None:
        actions = f"{self.name} has actions {self.space}"
        _check_kind(actions, self.space)
        _check_bounds(actions, self.space)
        self._check_float32(actions)
        try:
            Bins(self.low, self.high, 2)
        except UsageError as error:
            raise UsageError(f"{actions}: {error}") from None

    @property
    def low(self) -> Float[np.ndarray, " d"]:
        """The lower bounds, flat and in float32."""
        return self.space.low.astype(np.float32).ravel()

    @property
    def high(self) -> Float[np.ndarray, " d"]:
        """The upper bounds, flat and in float32."""
        return self.space.high.astype(np.float32).ravel()

    def to_env(self, action: Float[np.ndarray, "*batch d"]) -> np.ndarray:
        """Clipped into the exact bounds, in the environment's shape and precision; a copy."""
        space = self.space
        with np.errstate(over="ignore"):  # the bounds take care of it
            shaped = action.reshape((*action.shape[:-1], *space.shape)).astype(space.dtype)
        return np.asarray(np.minimum(np.maximum(shaped, space.low), space.high))

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
