"""A Gymnasium environment that can tell its state, for the tests of resuming; importable from another process."""

import gymnasium
import numpy as np
from gymnasium.spaces import Box
from gymnasium.wrappers import TimeLimit


class Swing(gymnasium.Env):
    """A noisy pendulum."""

    action_space = Box(-2.0, 2.0, (1,))
    observation_space = Box(-np.inf, np.inf, (2,))

    def reset(self, *, seed=None, options=None):
        super().reset(seed=seed)
        self.x = self.np_random.normal(size=2)
        return self.x.astype(np.float32), {}

    def step(self, action):
        angle, speed = self.x
        speed += 0.05 * (np.sin(angle) + float(action[0])) + 0.01 * self.np_random.normal()
        self.x = np.array([angle + 0.05 * speed, speed])
        return self.x.astype(np.float32), -float(self.x @ self.x), bool(abs(angle) > 4), False, {}


class StatefulSwing(Swing):
    """It tells its state."""

    def get_state(self):
        return {"x": self.x.copy()}

    def set_state(self, state):
        self.x = state["x"].copy()


def swing():
    return TimeLimit(Swing(), 13)


def stateful_swing():
    return TimeLimit(StatefulSwing(), 13)
