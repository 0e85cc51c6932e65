"""The records of tasks that other libraries have: what all of them have alike."""

import abc
import functools
from typing import Any, ClassVar

import jax
import numpy as np
from jaxtyping import Array, Float, Key

from galton.envs.base import box


class OtherRecord(abc.ABC):
    """A record whose task another library has: its name is told, and nothing is known of its returns and bounds."""

    name: str
    optimal_return: ClassVar[float | None] = None
    random_return: ClassVar[float | None] = None

    def __repr__(self) -> str:
        return self.name

    @abc.abstractmethod
    def reset(self, key: Key[Array, ""]) -> Any:
        """A first state, as `galton.envs.Environment` has it."""

    @abc.abstractmethod
    def observe(self, state: Any) -> Float[Array, " o"]:
        """The observation of a state, flat."""

    @property
    def observation_low(self) -> Float[np.ndarray, " o"]:
        """No bound, since not all tasks keep those that their library tells."""
        return -self.observation_high

    @functools.cached_property
    def observation_high(self) -> Float[np.ndarray, " o"]:
        """No bound, since not all tasks keep those that their library tells."""
        return box(np.inf, jax.eval_shape(lambda key: self.observe(self.reset(key)), jax.random.key(0)).size)
