"""Gymnasium's spaces as plain JSON, for a model's file."""

import math
from typing import Any

import numpy as np
from gymnasium.spaces import Box, Dict, Discrete, MultiBinary, MultiDiscrete, Tuple

from galton.envs.host.actions import Actions
from galton.envs.host.base import Space
from galton.errors import UsageError


def to_json(space: Space) -> dict[str, object]:
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


def actions_to_json(actions: Actions) -> dict[str, object]:
    """An action space, and beside it the number of entries of its masks where it has any."""
    record = to_json(actions.space)
    return {"Masked": [actions.n_mask, record]} if actions.n_mask else record


def actions_from_json(name: str, record: dict[str, Any]) -> Actions:
    """The actions that `actions_to_json` described; errors call them by this name."""
    n_mask, record = record.get("Masked", (0, record))
    return Actions(name, from_json(record), n_mask=n_mask)


def n_entries(record: dict[str, Any]) -> int:
    """The Boxes that `to_json` described have so many entries."""
    ((kind, content),) = record.items()
    if kind in ("Dict", "Tuple"):
        return sum(n_entries(part[1] if kind == "Dict" else part) for part in content)
    if kind == "Masked":
        return n_entries(content[1])
    return abs(math.prod(content[2])) if kind == "Box" else int(np.prod(content)) if kind == "MultiBinary" else 0


def from_json(record: dict[str, Any]) -> Space:
    """The space that `to_json` described; ValueError for a Box that is not of numbers."""
    ((kind, content),) = record.items()
    if kind == "Dict":
        return Dict([(key, from_json(part)) for key, part in content])  # in this order
    if kind == "Tuple":
        return Tuple([from_json(part) for part in content])
    if kind == "Box":
        low, high, shape, dtype = content
        if np.dtype(dtype).kind not in "fiub":
            raise ValueError(f"a space is of {dtype}, not of numbers")
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
