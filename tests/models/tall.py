"""An environment whose spaces have shapes."""

import gymnasium
import numpy as np
from gymnasium.spaces import Box


class Tall(gymnasium.Env):
    """Actions of shape (2, 2) in float64, unsymmetric; observations of shape (2, 3); five steps an episode."""

    action_space = Box(np.array([[-1.0, 0.0], [0.0, -3.0]]), np.array([[2.0, 0.5], [4.0, 5.0]]), dtype=np.float64)
    observation_space = Box(-1.0, 1.0, (2, 3))

    def reset(self, *, seed=None, options=None):
        super().reset(seed=seed)
        self.t = 0
        return self.np_random.uniform(-1, 1, (2, 3)).astype(np.float32), {}

    def step(self, action):
        assert self.action_space.contains(action)
        self.t += 1
        observation = self.np_random.uniform(-1, 1, (2, 3)).astype(np.float32)
        return observation, -float(np.square(action).sum()), False, self.t == 5, {}
