"""Gymnasium's spaces as the flat float32 vectors that networks and policies work on."""

import dataclasses
from typing import Any

import gymnasium
import numpy as np
from gymnasium.spaces import Box, Dict, Discrete, MultiBinary, MultiDiscrete, Tuple
from gymnasium.spaces.utils import flatdim, flatten
from gymnasium.vector.utils import batch_space, iterate
from jaxtyping import Float

from galton.bins import Bins
from galton.errors import BrokenEnvironmentError, UsageError, require


@dataclasses.dataclass(frozen=True)
class ActionBox:
    """A checked action space.

    Raises:
        UsageError: a space that isn't a Box with finite bounds in every dimension.
    """

    name: str
    space: Any

    def __post_init__(self) -> None:
        actions, space = f"{self.name} has actions {self.space}", self.space
        require(
            isinstance(space, Box),
            f"{actions}; Galton is for continuous actions and needs a Box. Wrap the environment so that it takes one "
            "(gymnasium.wrappers.TransformAction)",
        )
        require(space.dtype.kind == "f", f"{actions}, which are integers; Galton needs a Box of floating-point numbers")
        require(np.prod(space.shape) > 0, f"{actions}, a box without dimensions; there is nothing to learn")
        remedy = "Give it finite bounds: gymnasium.wrappers.TransformAction(env, lambda action: action, Box(low, high))"
        for bound, side in ((space.low, "low"), (space.high, "high")):
            for problem, where in (("not a number", np.isnan(bound)), ("unbounded", np.isinf(bound))):
                index = ", ".join(map(str, np.argwhere(where)[0])) if where.any() else ""
                require(not where.any(), f"{actions}; {side} is {problem} at [{index}], and bins need an end. {remedy}")
        require((space.low < space.high).all(), f"{actions}; each low must lie below its high")
        try:
            Bins(self.low, self.high, 2)
        except UsageError as error:
            raise UsageError(f"{actions}: {error}") from None

    @property
    def low(self) -> Float[np.ndarray, " d"]:
        """Lower bounds."""
        low: np.ndarray = self.space.low.astype(np.float32).ravel()
        return low

    @property
    def high(self) -> Float[np.ndarray, " d"]:
        """Upper bounds."""
        high: np.ndarray = self.space.high.astype(np.float32).ravel()
        return high

    def to_env(self, action: Float[np.ndarray, "*batch d"]) -> np.ndarray:
        """Clipped into the exact bounds, in the environment's shape and precision; a copy."""
        shaped = action.reshape(*action.shape[:-1], *self.space.shape)
        clipped: np.ndarray = np.clip(shaped, self.space.low, self.space.high, dtype=self.space.dtype)
        return clipped


@dataclasses.dataclass(frozen=True)
class Observations:
    """A checked observation space.

    Raises:
        UsageError: a space that can't be flattened into a vector.
    """

    name: str
    space: gymnasium.Space[Any]

    def __post_init__(self) -> None:
        remedy = "wrap the environment so that it observes a Box, or a Dict or Tuple of them"
        observations = f"{self.name} observes {self.space}"
        require(
            isinstance(self.space, gymnasium.Space) and bool(self.space.is_np_flattenable),
            f"{observations}, which has no fixed size; {remedy}",
        )
        require(self.size > 0, f"{observations}, which is empty; {remedy}")

    @property
    def size(self) -> int:
        """Entries of the flat vector."""
        return int(flatdim(self.space))

    def flatten(self, raw: Any, where: str) -> Float[np.ndarray, " o"]:
        """One observation as a vector; BrokenEnvironmentError says what is wrong with it."""
        if isinstance(self.space, Box):
            try:
                values = np.asarray(raw)
            except ValueError:
                values = np.asarray(None)
            if values.shape != self.space.shape or values.dtype.kind not in "fiub":
                raise BrokenEnvironmentError(f"{where}: the observation is {shown(raw)}; the space is {self.space}")
        else:
            try:
                self._check_parts(self.space, raw)
                values = np.asarray(flatten(self.space, raw))
            except (TypeError, ValueError, KeyError, AttributeError, IndexError, AssertionError) as error:
                raise BrokenEnvironmentError(
                    f"{where}: the observation is {shown(raw)}, which the space {self.space} can't hold: {error!r}"
                ) from error
        return as_float32(values, "the observation", where).ravel()

    def rows(self, observation: Any) -> tuple[Float[np.ndarray, "n o"], bool]:
        """One observation or a batch of them as rows, and whether it was one; UsageError for anything else."""
        try:
            if isinstance(self.space, Box):
                values = np.asarray(observation)
                single = values.shape == self.space.shape
                require(single or values.shape[1:] == self.space.shape, f"its shape is {values.shape}")
                require(values.dtype.kind in "fiub", f"its type is {values.dtype}")
                rows = as_float32(values, "it", "predict").reshape(-1, self.size)
                return rows, single
            single = _depth(observation, self.space) == 0
            parts = [observation] if single else list(iterate(batch_space(self.space, 1), observation))
            return np.stack([self.flatten(part, "predict") for part in parts]), single
        except (BrokenEnvironmentError, UsageError, TypeError, ValueError, KeyError, IndexError) as error:
            raise UsageError(
                f"observation is {shown(observation)}: {error}; it must be one of {self.space}, or a batch of them"
            ) from None

    def _check_parts(self, space: gymnasium.Space[Any], raw: Any) -> None:
        """What `flatten` would not notice."""
        if isinstance(space, Dict):
            if set(raw) != set(space.spaces):
                raise KeyError(f"its keys are {sorted(raw)}")
            for key, part in space.spaces.items():
                self._check_parts(part, raw[key])
        elif isinstance(space, Tuple):
            if len(raw) != len(space.spaces):
                raise ValueError(f"it has {len(raw)} parts")
            for part, value in zip(space.spaces, raw, strict=True):
                self._check_parts(part, value)
        elif np.shape(raw) != space.shape:
            raise ValueError(f"a part has shape {np.shape(raw)} instead of {space.shape}")


def as_float32(values: np.ndarray, what: str, where: str) -> Float[np.ndarray, "..."]:
    """The same numbers for the networks, copied; BrokenEnvironmentError if one of them is not finite."""
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


def shown(value: Any) -> str:
    """A value in an error message, cut short."""
    text = " ".join(repr(value).split())
    described = f" of shape {value.shape}" if isinstance(value, np.ndarray) else ""
    return (text if len(text) <= 120 else f"{text[:117]}...") + described


def _depth(observation: Any, space: gymnasium.Space[Any]) -> int:
    """How many axes an observation has beyond those of its space: 0, or 1 for a batch."""
    if isinstance(space, Dict):
        key, part = next(iter(space.spaces.items()))
        return _depth(observation[key], part)
    if isinstance(space, Tuple):
        return _depth(observation[0], space.spaces[0])
    return np.ndim(observation) - len(space.shape or ())


def to_json(space: gymnasium.Space[Any]) -> dict[str, Any]:
    """A space in plain words, for a checkpoint."""
    if isinstance(space, Dict):
        return {"Dict": [[key, to_json(part)] for key, part in space.spaces.items()]}
    if isinstance(space, Tuple):
        return {"Tuple": [to_json(part) for part in space.spaces]}
    if isinstance(space, Box):
        bounds = [space.low.ravel().tolist(), space.high.ravel().tolist()]
        if all(len(set(bound)) == 1 for bound in bounds):  # an image has many equal ones
            bounds = [[bound[0]] for bound in bounds]
        return {"Box": [*bounds, list(space.shape), space.dtype.str]}
    if isinstance(space, Discrete):
        return {"Discrete": [int(space.n), int(space.start)]}
    if isinstance(space, MultiDiscrete):
        return {"MultiDiscrete": space.nvec.tolist()}
    if isinstance(space, MultiBinary):
        return {"MultiBinary": [int(n) for n in space.shape]}
    raise UsageError(f"a space of type {type(space).__name__} can't be saved")


def from_json(record: dict[str, Any]) -> gymnasium.Space[Any]:
    """Undo `to_json`."""
    ((kind, content),) = record.items()
    if kind == "Dict":
        return Dict({key: from_json(part) for key, part in content})
    if kind == "Tuple":
        return Tuple([from_json(part) for part in content])
    if kind == "Box":
        low, high, shape, dtype = content
        low, high = (
            np.broadcast_to(np.array(bound, dtype), shape) if len(bound) == 1 else np.array(bound, dtype).reshape(shape)
            for bound in (low, high)
        )
        return Box(low, high, tuple(shape), np.dtype(dtype).type)
    if kind == "Discrete":
        return Discrete(content[0], start=content[1])
    if kind == "MultiDiscrete":
        return MultiDiscrete(content)
    if kind == "MultiBinary":
        return MultiBinary(content)
    raise ValueError(f"no space is called {kind!r}")
