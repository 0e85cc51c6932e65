"""Tasks of gymnax as records."""

import dataclasses
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from gymnasium import spaces
from jaxtyping import Array, Bool, Float, Key, PyTree

from galton.envs.other_record import OtherRecord

ENDLESS = 2**30
"""Steps of an episode that no time limit cuts off."""


@dataclasses.dataclass(frozen=True, repr=False)
class Gymnax(OtherRecord):
    """A task of gymnax (Lange, 2022): its own steps and first states, with time limits told apart from ends."""

    env: Any
    params: Any
    """The task's constants, gymnax's EnvParams."""
    name: str
    max_episode_steps: int
    n_actions: int
    """The number of actions to choose from; 0 where actions are numbers."""
    shape: tuple[int, ...] = ()
    """The shape of actions that are numbers."""
    low: tuple[float, ...] = ()
    """The bounds of their entries."""
    high: tuple[float, ...] = ()

    @property
    def action_space(self) -> spaces.Space[Any]:
        """The actions, as the task has them."""
        if self.n_actions:
            return spaces.Discrete(self.n_actions)
        low, high = (np.reshape(np.array(bound, np.float32), self.shape) for bound in (self.low, self.high))
        return spaces.Box(low, high)

    def reset(self, key: Key[Array, ""]) -> tuple[Array, PyTree[Array]]:
        """The first observation and state."""
        return self.env.reset_env(key, self.params)

    def noise(self, key: Key[Array, ""]) -> Key[Array, ""]:
        """The key of the step, since gymnax draws inside of it."""
        return key

    def step(
        self, state: tuple[Array, PyTree[Array]], action: Any, noise: Key[Array, ""]
    ) -> tuple[tuple[Array, PyTree[Array]], Float[Array, ""], Bool[Array, ""]]:
        """One step; it has ended where the same step without a time limit has."""
        observation, after, reward, _, _ = self.env.step_env(noise, state[1], action, self.params)
        endless = self.params.replace(max_steps_in_episode=ENDLESS)
        *_, ended, _ = self.env.step_env(noise, state[1], action, endless)
        following = jax.tree.map(lambda new, old: jnp.asarray(new, old.dtype), (observation, after), state)
        return following, jnp.asarray(reward, float), jnp.asarray(ended, bool)

    def observe(self, state: tuple[Array, PyTree[Array]]) -> Float[Array, " o"]:
        """The observation that the policy sees, flat."""
        return jnp.ravel(state[0]).astype(float)
