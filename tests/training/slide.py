"""One deterministic task twice: for the engine on the device and, written again in numpy, for the one on the host."""

import dataclasses

import gymnasium
import jax.numpy as jnp
import numpy as np
from gymnasium.spaces import Box

LOW, HIGH = np.array([-1.0, -2.0], np.float32), np.array([1.0, 3.0], np.float32)
START, EDGE, LIMIT = np.array([0.5, -0.25, 0.0], np.float32), np.float32(0.8), 7


@dataclasses.dataclass(frozen=True)
class Slide:
    """A point that is pushed, and falls off beyond an edge; three numbers to see, two to push with."""

    max_episode_steps: int = LIMIT

    action_low, action_high = LOW, HIGH
    observation_low, observation_high = np.full(3, -10, np.float32), np.full(3, 10, np.float32)
    optimal_return = None
    random_return = None

    def reset(self, key):
        return jnp.asarray(START)

    def noise(self, key):
        return ()

    def step(self, state, action, noise):
        position = 0.9 * state[:2] + 0.3 * action
        following = jnp.append(position, state[2] + 0.125)
        return following, 1.0 - position @ position, position[0] > EDGE

    def observe(self, state):
        return state


class SlideEnv(gymnasium.Env):
    """The same with Gymnasium's interface."""

    action_space = Box(LOW, HIGH)
    observation_space = Box(-10.0, 10.0, (3,))

    def reset(self, *, seed=None, options=None):
        super().reset(seed=seed)
        self.state = START.copy()
        return self.state, {}

    def step(self, action):
        position = np.float32(0.9) * self.state[:2] + np.float32(0.3) * action
        self.state = np.array([*position, self.state[2] + np.float32(0.125)], np.float32)
        return self.state, float(1 - position @ position), bool(position[0] > EDGE), False, {}


def slide():
    return gymnasium.wrappers.TimeLimit(SlideEnv(), LIMIT)
