"""The continuous bandit (§5.2.2, App. C.1)."""

import abc
import dataclasses

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Key

from galton.envs.base import box
from galton.errors import require, require_integer


class OneState:
    """A task of one state and one step, with the same bounds in every dimension and a noisy reward."""

    max_episode_steps = 1
    observation_low = box(0.0, 1)
    observation_high = box(1.0, 1)
    bound: float
    d: int
    noise_std: float

    def __post_init__(self) -> None:
        require_integer("d", self.d, 1)
        require(0 <= self.noise_std < float("inf"), f"noise_std is {self.noise_std}; it must be 0 or more")

    @property
    def action_low(self) -> Float[np.ndarray, " d"]:
        """The lower bound, the same in every dimension."""
        return box(-self.bound, self.d)

    @property
    def action_high(self) -> Float[np.ndarray, " d"]:
        """The upper bound, the same in every dimension."""
        return box(self.bound, self.d)

    def noise(self, key: Key[Array, ""]) -> Float[Array, ""]:
        """The noise ε of the reward."""
        return self.noise_std * jax.random.normal(key)


class OneStep(OneState, abc.ABC):
    """One whose subclasses say what an action is worth."""

    @abc.abstractmethod
    def worth(self, action: Float[Array, "*batch d"]) -> Float[Array, "*batch"]:
        """The expected reward of an action."""

    def reset(self, key: Key[Array, ""]) -> Float[Array, " 1"]:
        """The one state that there is."""
        return jnp.ones(1)

    def step(
        self, state: Float[Array, " 1"], action: Float[Array, " d"], noise: Float[Array, ""] | float
    ) -> tuple[Float[Array, " 1"], Float[Array, ""], Bool[Array, ""]]:
        """Reward the action and end."""
        return state, self.worth(action) + noise, jnp.array(True)

    def observe(self, state: Float[Array, " 1"]) -> Float[Array, " 1"]:
        """The observation, which is the constant 1."""
        return state


@dataclasses.dataclass(frozen=True)
class Bandit(OneStep):
    """One state, one step, reward 25 − (1/d) Σ (a_i − 5)² + ε with ε ~ N(0, noise_std²), actions in [−10, 10]^d.

    The paper leaves the box and the observation open; the observation is the constant 1.
    """

    d: int = 2
    """The number of dimensions of an action."""
    noise_std: float = 1.0
    """The standard deviation of the reward's noise, ε."""

    bound = 10.0
    optimal_return = 25.0
    random_return = 25.0 - (25.0 + 100.0 / 3)
    """E (a − 5)² = 5² + Var a."""

    def worth(self, action: Float[Array, "*batch d"]) -> Float[Array, "*batch"]:
        """25 − (1/d) Σ (a_i − 5)²."""
        return 25.0 - jnp.mean((action - 5.0) ** 2, -1)
