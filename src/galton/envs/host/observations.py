"""Gymnasium's observations as flat vectors: in float32, or in float64 where that would take digits from them."""

import dataclasses
import functools
from typing import Any

import numpy as np
from gymnasium.spaces import Box, Dict, Discrete, MultiBinary, MultiDiscrete, Tuple
from gymnasium.spaces.utils import flatdim, flatten
from gymnasium.vector.utils import batch_space, iterate
from jaxtyping import Float, Shaped

from galton.envs.host.actions import leaves
from galton.envs.host.answers import as_float32, as_numbers, shown
from galton.envs.host.base import Space
from galton.errors import BrokenEnvironmentError, UsageError, require

IMAGE_REMEDY = (
    "an image is flattened, and its numbers from 0 to 255 saturate tanh units; Galton has no convolutions: wrap the "
    "environment so that it observes features of the image, or train with normalize_observation=True"
)
"""The remedy for an observation that is an image."""


@dataclasses.dataclass(frozen=True)
class Observations:
    """A checked observation space; UsageError for one that can't be flattened into a vector."""

    name: str
    space: Space
    n_mask: int = 0
    """The entries of an action mask, which follow the observation's own in a vector."""

    def __post_init__(self) -> None:
        remedy = "wrap the environment so that it observes a Box, or a Dict or Tuple of them"
        observations = f"{self.name} observes {self.space}"
        require(
            all(isinstance(leaf, Box | Discrete | MultiDiscrete | MultiBinary) for _, leaf in leaves(self.space)),
            f"{observations}; only Box, Discrete, MultiDiscrete, MultiBinary, and Dict and Tuple of them, can be "
            f"flattened: {remedy}",
        )
        require(self.size > 0, f"{observations}, which is empty; {remedy}")

    @functools.cached_property
    def size(self) -> int:
        """The number of entries of the flat vector."""
        return int(flatdim(self.space)) + self.n_mask

    @property
    def has_image(self) -> bool:
        """Say whether a Box of bytes in three dimensions is in it, as images are."""
        boxes = [leaf for _, leaf in leaves(self.space) if isinstance(leaf, Box)]
        return any(box.dtype == np.uint8 and len(box.shape) == 3 for box in boxes)

    @functools.cached_property
    def dtype(self) -> np.dtype[np.floating[Any]]:
        """Vectors hold float32 where that has all numbers of the space, else float64."""
        kinds = [leaf.dtype for _, leaf in leaves(self.space) if isinstance(leaf, Box)]
        return np.dtype(np.float32 if all(np.can_cast(kind, np.float32) for kind in kinds) else np.float64)

    def flatten(self, raw: object, where: str) -> Float[np.ndarray, " o"]:
        """One observation as a vector; BrokenEnvironmentError says what is wrong with it."""
        return self.checked(self.numbers(raw, where), "the observation", where).ravel()

    def checked(self, values: np.ndarray, what: str, where: str) -> Float[np.ndarray, "..."]:
        """The same numbers as vectors hold them, copied; BrokenEnvironmentError if float32 can't hold one."""
        narrow = as_float32(values, what, where)
        return narrow if self.dtype == narrow.dtype else values.astype(self.dtype)

    def numbers(self, raw: object, where: str) -> Shaped[np.ndarray, "..."]:
        """One observation as it came, of the right shape; whether it is finite is not looked at."""
        if isinstance(self.space, Box):
            values = as_numbers(raw)
            if values is None or values.shape != self.space.shape:
                raise BrokenEnvironmentError(f"{where}: the observation is {shown(raw)}; the space is {self.space}")
            return values
        try:
            _check_parts(self.space, raw, "the observation", where)
            with np.errstate(over="ignore"):  # whoever asks for float32 finds it
                return np.asarray(flatten(self.space, raw))
        except BrokenEnvironmentError:
            raise
        except Exception as error:
            raise BrokenEnvironmentError(
                f"{where}: the observation is {shown(raw)}, which the space {self.space} can't hold: {error!r}"
            ) from error

    def rows(self, observation: object, masks: object = None) -> tuple[Float[np.ndarray, "n o"], bool]:
        """One observation or a batch of them as rows, and whether it was one; UsageError for anything else.

        Masks follow their observations; without any, all values are allowed.
        """
        rows, single = self._rows(observation)
        if not self.n_mask:
            require(masks is None, "action_masks are given, and the environment that the model was made on has none")
            return rows, single
        allowed = as_numbers(np.ones((len(rows), self.n_mask)) if masks is None else masks)
        fits = allowed is not None and allowed.size == len(rows) * self.n_mask and np.isin(allowed, (0, 1)).all()
        require(
            fits, f"action_masks is {shown(masks)}; it must be {self.n_mask} of True and False for each observation"
        )
        assert allowed is not None
        return np.concatenate([rows, allowed.reshape(len(rows), self.n_mask).astype(rows.dtype)], -1), single

    def _rows(self, observation: Any) -> tuple[Float[np.ndarray, "n o"], bool]:
        try:
            if isinstance(self.space, Box):
                values = np.asarray(observation)
                single = values.shape == self.space.shape
                require(single or values.shape[1:] == self.space.shape, f"its shape is {values.shape}")
                require(values.dtype.kind in "fiub", f"its type is {values.dtype}")
                return self.checked(values, "it", "predict").reshape(-1, self.size - self.n_mask), single
            found = [
                (functools.reduce(lambda part, key: part[key], keys, observation), leaf)
                for keys, leaf in leaves(self.space)
            ]
            single = np.ndim(found[0][0]) == len(found[0][1].shape or ())
            if not single:
                lengths = {len(part) for part, _ in found}
                require(len(lengths) == 1, f"its parts are batches of {sorted(lengths)}")
            one_by_one = [observation] if single else iterate(batch_space(self.space, 1), observation)
            return np.stack([self.flatten(part, "predict") for part in one_by_one]), single
        except (BrokenEnvironmentError, UsageError, TypeError, ValueError, KeyError, IndexError) as error:
            raise UsageError(
                f"observation is {shown(observation)}: {error}; it must be one of {self.space}, or a batch of them"
            ) from None


def _check_parts(space: Space, raw: Any, name: str, where: str) -> None:
    """Raise for what is wrong with an observation and `flatten` would not notice."""
    if isinstance(space, Dict):
        if set(raw) != set(space.spaces):
            raise KeyError(f"the keys of {name} are {list(raw)}")
        for key, part in space.spaces.items():
            _check_parts(part, raw[key], f"{name}[{key!r}]", where)
    elif isinstance(space, Tuple):
        if not isinstance(raw, tuple | list | np.ndarray) or len(raw) != len(space.spaces):
            raise ValueError(f"{name} must be a tuple of {len(space.spaces)}")
        for i, (part, value) in enumerate(zip(space.spaces, raw, strict=True)):
            _check_parts(part, value, f"{name}[{i}]", where)
    elif isinstance(space, Box):
        values = as_numbers(raw)
        if values is None or values.shape != space.shape:
            raise ValueError(f"{name} is {shown(raw)}, which must have shape {space.shape}")
        as_float32(values, name, where)
        if space.dtype.kind != "f" and not np.array_equal(values.astype(space.dtype), values):
            raise ValueError(f"{name} is {shown(raw)}, which must be {space.dtype}")
    elif not space.contains(raw):
        raise ValueError(f"{name} is {shown(raw)}, which is not in {space}")
