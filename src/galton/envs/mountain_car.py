"""Continuous Mountain Car (App. C.1), exactly Gymnasium's MountainCarContinuous-v0."""

import dataclasses

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Key

from galton.envs.base import box

MIN_POSITION, MAX_POSITION, MAX_SPEED, GOAL = -1.2, 0.6, 0.07, 0.45
POWER, GRAVITY = 0.0015, 0.0025


@dataclasses.dataclass(frozen=True)
class MountainCar:
    """A car too weak for the hill: state (position, velocity), force in [−1, 1].

    The reward is 100 at the flag, less 0.1 force² a step. The best return is not known in closed form.
    """

    max_episode_steps = 999
    action_low = box(-1.0, 1)
    action_high = box(1.0, 1)
    observation_low = np.array([MIN_POSITION, -MAX_SPEED], np.float32)
    observation_high = np.array([MAX_POSITION, MAX_SPEED], np.float32)
    optimal_return = None
    random_return = None

    def reset(self, key: Key[Array, ""]) -> Float[Array, " 2"]:
        """At rest in the valley, position ~ U(−0.6, −0.4)."""
        return jnp.stack([jax.random.uniform(key, minval=-0.6, maxval=-0.4), jnp.zeros(())])

    def noise(self, key: Key[Array, ""]) -> tuple[()]:
        """No noise, (), since the car is deterministic."""
        return ()

    def step(
        self, state: Float[Array, " 2"], action: Float[Array, " 1"], noise: tuple[()]
    ) -> tuple[Float[Array, " 2"], Float[Array, ""], Bool[Array, ""]]:
        """Push, roll, stop at the left wall."""
        position, velocity = state
        force = jnp.clip(action[0], -1.0, 1.0)
        velocity = velocity + (force * POWER - GRAVITY * jnp.cos(3 * position))
        velocity = jnp.clip(velocity, -MAX_SPEED, MAX_SPEED)
        position = jnp.clip(position + velocity, MIN_POSITION, MAX_POSITION)
        velocity = jnp.where((position == MIN_POSITION) & (velocity < 0), 0.0, velocity)
        terminated = (position >= GOAL) & (velocity >= 0)
        return (
            jnp.stack([position, velocity]),
            jnp.where(terminated, 100.0, 0.0) - 0.1 * action[0] ** 2,
            terminated,
        )

    def observe(self, state: Float[Array, " 2"]) -> Float[Array, " 2"]:
        """The agent sees the whole state."""
        return state
