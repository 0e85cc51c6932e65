"""Gymnasium's spaces as the flat float32 vectors that networks and policies work on."""

import dataclasses
import functools
from typing import Any

import gymnasium
import numpy as np
from gymnasium.spaces import Box, Dict, Discrete, MultiBinary, MultiDiscrete, Tuple
from gymnasium.spaces.utils import flatdim, flatten
from gymnasium.vector.utils import batch_space, iterate
from jaxtyping import Float

from galton.bins import Bins
from galton.errors import BrokenEnvironmentError, UsageError, require

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
        actions, space = f"{self.name} has actions {self.space}", self.space
        require(
            isinstance(space, Box),
            f"{actions}; Galton is for continuous actions and needs a Box. Wrap the environment so that it takes one "
            "(gymnasium.wrappers.TransformAction)",
        )
        require(
            space.dtype.kind == "f",
            f"{actions}, whose type is {space.dtype}; Galton needs a Box of floating-point numbers. Wrap the "
            "environment so that it takes one and rounds (gymnasium.wrappers.TransformAction)",
        )
        require(np.prod(space.shape) > 0, f"{actions}, a box without dimensions; give it one at least")
        remedy = "Give it finite bounds: gymnasium.wrappers.TransformAction(env, lambda action: action, Box(low, high))"
        for bound, side in ((space.low, "low"), (space.high, "high")):
            for problem, where in (("not a number", np.isnan(bound)), ("unbounded", np.isinf(bound))):
                index = ", ".join(map(str, np.argwhere(where)[0])) if where.any() else ""
                require(not where.any(), f"{actions}; {side} is {problem} at [{index}], and bins need an end. {remedy}")
        empty = np.argwhere(space.low >= space.high)
        index = ", ".join(map(str, empty[0])) if len(empty) else ""
        require(
            not len(empty), f"{actions}; low must lie below high at [{index}]. Leave that dimension out or widen it"
        )
        spans = space.high.astype(np.float64) - space.low.astype(np.float64)
        require(
            (abs(np.stack([space.low, space.high, spans])) <= np.finfo(np.float32).max).all(),
            f"{actions}, which is too large for float32; wrap the environment so that it takes smaller actions "
            "(gymnasium.wrappers.RescaleAction)",
        )
        require(
            (spans > LEAST_SPAN).all() and (self.low < self.high).all(),
            f"{actions}, which is too narrow for float32; wrap the environment so that it takes larger actions "
            "(gymnasium.wrappers.RescaleAction)",
        )
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
        space = self.space
        with np.errstate(over="ignore"):  # the bounds take care of it
            shaped = action.reshape((*action.shape[:-1], *space.shape)).astype(space.dtype)
        return np.asarray(np.minimum(np.maximum(shaped, space.low), space.high))


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
            _has_fixed_size(self.space),
            f"{observations}; only Box, Discrete, MultiDiscrete, MultiBinary, and Dict and Tuple of them, can be "
            f"flattened: {remedy}",
        )
        require(self.size > 0, f"{observations}, which is empty; {remedy}")

    @functools.cached_property
    def size(self) -> int:
        """Entries of the flat vector."""
        return int(flatdim(self.space))

    def flatten(self, raw: Any, where: str) -> Float[np.ndarray, " o"]:
        """One observation as a vector; BrokenEnvironmentError says what is wrong with it."""
        return as_float32(self.numbers(raw, where), "the observation", where).ravel()

    def numbers(self, raw: Any, where: str) -> np.ndarray:
        """One observation as it came, of the right shape; whether it is finite is not looked at."""
        if isinstance(self.space, Box):
            values = as_numbers(raw)
            if values is None or values.shape != self.space.shape:
                raise BrokenEnvironmentError(f"{where}: the observation is {shown(raw)}; the space is {self.space}")
        else:
            try:
                self._check_parts(self.space, raw, "the observation", where)
                with np.errstate(over="ignore"):  # found below
                    values = np.asarray(flatten(self.space, raw))
            except BrokenEnvironmentError:
                raise
            except Exception as error:
                raise BrokenEnvironmentError(
                    f"{where}: the observation is {shown(raw)}, which the space {self.space} can't hold: {error!r}"
                ) from error
        return values

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
            if not single:
                lengths = _lengths(observation, self.space)
                require(len(lengths) == 1, f"its parts are batches of {sorted(lengths)}")
            parts = [observation] if single else list(iterate(batch_space(self.space, 1), observation))
            return np.stack([self.flatten(part, "predict") for part in parts]), single
        except (BrokenEnvironmentError, UsageError, TypeError, ValueError, KeyError, IndexError) as error:
            raise UsageError(
                f"observation is {shown(observation)}: {error}; it must be one of {self.space}, or a batch of them"
            ) from None

    def _check_parts(self, space: gymnasium.Space[Any], raw: Any, name: str, where: str) -> None:
        """What `flatten` would not notice."""
        if isinstance(space, Dict):
            if set(raw) != set(space.spaces):
                raise KeyError(f"the keys of {name} are {list(raw)}")
            for key, part in space.spaces.items():
                self._check_parts(part, raw[key], f"{name}[{key!r}]", where)
        elif isinstance(space, Tuple):
            if not isinstance(raw, tuple | list | np.ndarray) or len(raw) != len(space.spaces):
                raise ValueError(f"{name} must be a tuple of {len(space.spaces)}")
            for i, (part, value) in enumerate(zip(space.spaces, raw, strict=True)):
                self._check_parts(part, value, f"{name}[{i}]", where)
        elif isinstance(space, Box):
            values = as_numbers(raw)
            if values is None or values.shape != space.shape:
                raise ValueError(f"{name} is {shown(raw)}, which must have shape {space.shape}")
            as_float32(values, name, where)
            if space.dtype.kind != "f" and not np.array_equal(values.astype(space.dtype), values):
                raise ValueError(f"{name} is {shown(raw)}, which must be {space.dtype}")
        elif not space.contains(raw):
            raise ValueError(f"{name} is {shown(raw)}, which is not in {space}")


def as_numbers(raw: Any) -> np.ndarray | None:
    """What an environment returned as an array; None if it isn't one of real numbers."""
    try:
        values = np.asarray(raw)
    except Exception:  # anything may come, even with an __array__ that fails
        return None
    return values if values.dtype.kind in "fiub" else None


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
    try:
        text = " ".join(repr(value).split())
    except Exception:
        text = f"a {type(value).__name__} that can't be shown"
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


def _lengths(observation: Any, space: gymnasium.Space[Any]) -> set[int]:
    """Of the batches in a batch of observations."""
    if isinstance(space, Dict):
        return set().union(*(_lengths(observation[key], part) for key, part in space.spaces.items()))
    if isinstance(space, Tuple):
        return set().union(*(_lengths(observation[i], part) for i, part in enumerate(space.spaces)))
    return {len(observation)}


def _has_fixed_size(space: Any) -> bool:
    if isinstance(space, Dict):
        return all(map(_has_fixed_size, space.spaces.values()))
    if isinstance(space, Tuple):
        return all(map(_has_fixed_size, space.spaces))
    return isinstance(space, Box | Discrete | MultiDiscrete | MultiBinary)


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
        return {"Discrete": [int(space.n), int(space.start), space.dtype.str]}
    if isinstance(space, MultiDiscrete):
        return {"MultiDiscrete": [space.nvec.tolist(), space.start.tolist(), space.dtype.str]}
    if isinstance(space, MultiBinary):
        return {"MultiBinary": space.n if isinstance(space.n, int) else [int(n) for n in space.n]}
    raise UsageError(f"a space of type {type(space).__name__} can't be saved")


def from_json(record: dict[str, Any]) -> gymnasium.Space[Any]:
    """Undo `to_json`."""
    ((kind, content),) = record.items()
    if kind == "Dict":
        return Dict([(key, from_json(part)) for key, part in content])  # in this order
    if kind == "Tuple":
        return Tuple([from_json(part) for part in content])
    if kind == "Box":
        low, high, shape, dtype = content
        low, high = (
            np.full(shape, bound[0], dtype) if len(bound) == 1 else np.array(bound, dtype).reshape(shape)
            for bound in (low, high)
        )
        return Box(low, high, tuple(shape), np.dtype(dtype).type)
    if kind == "Discrete":
        n, start, dtype = content
        return Discrete(n, start=start, dtype=np.dtype(dtype).type)
    if kind == "MultiDiscrete":
        nvec, start, dtype = content
        return MultiDiscrete(nvec, dtype=np.dtype(dtype).type, start=start)
    if kind == "MultiBinary":
        return MultiBinary(content)
    raise ValueError(f"no space is called {kind!r}")
