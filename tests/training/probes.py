"""Tasks so small that a failure points at its cause."""

import dataclasses

import jax
import jax.numpy as jnp

from galton.envs.base import box


@dataclasses.dataclass(frozen=True)
class Probe:
    """Actions in [−1, 1]; the observation is a coin fixed for the episode; the state is (coin, time)."""

    reward: str
    """constant: 1 · coin: the coin · action: −(a − coin)² · delayed: the coin, on the last of two steps."""
    max_episode_steps: int = 1
    terminates: bool = True

    action_low = box(-1.0, 1)
    action_high = box(1.0, 1)
    observation_low = box(-1.0, 1)
    observation_high = box(1.0, 1)
    optimal_return = None
    random_return = None

    def reset(self, key):
        return jnp.stack([jax.random.rademacher(key, (), jnp.float32), jnp.zeros(())])

    def noise(self, key):
        return ()

    def step(self, state, action, noise):
        coin, time = state
        last = time + 1 >= self.max_episode_steps
        reward = {
            "constant": jnp.ones(()),
            "coin": coin,
            "action": -((action[0] - coin) ** 2),
            "delayed": jnp.where(last, coin, 0.0),
        }[self.reward]
        return jnp.stack([coin, time + 1]), reward, last & self.terminates

    def observe(self, state):
        return state[:1]
