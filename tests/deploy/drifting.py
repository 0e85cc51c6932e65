"""A small environment with an action box that one chooses, for policies that are to be exported."""

import gymnasium
import numpy as np
from gymnasium.spaces import Box

import galton

LOW = np.array([-1.0, 0.0, -10.0, -2.0, -1.0, -4.0], np.float32)
HIGH = np.array([3.0, 5.0, 10.0, 1.0, 1.0, 0.5], np.float32)
"""Bounds that are not symmetric, each other ones."""
OWN = {"ppo": {"batch_size": 16, "n_epochs": 2}}


class Drifting(gymnasium.Env):
    """Observations are noise around 1; the reward is largest where the action is the first of them in its box."""

    def __init__(self, low=LOW, high=HIGH, n_observed=5):
        self.action_space = Box(np.asarray(low, np.float32), np.asarray(high, np.float32))
        self.observation_space = Box(-np.inf, np.inf, (n_observed,))
        self.t, self.seen = 0, None

    def reset(self, *, seed=None, options=None):
        super().reset(seed=seed)
        self.t = 0
        return self._observe(), {}

    def step(self, action):
        space, self.t = self.action_space, self.t + 1
        wanted = space.low + (space.high - space.low) / (1 + np.exp(-self.seen[0]))
        reward = -float(np.square((action - wanted) / (space.high - space.low)).mean())
        return self._observe(), reward, False, self.t >= 20, {}

    def _observe(self):
        shape = self.observation_space.shape
        self.seen = (1 + 3 * self.np_random.normal(size=shape)).astype(np.float32)
        return self.seen


def trained(policy, algorithm, d=6, steps=640, **settings):
    """A model that has learned a little: its normaliser has seen something, and its outputs depend on the state."""
    loss = "gaussian" if galton.POLICIES[policy].family == "density" else "hl-gauss"
    d = min(d, 2) if policy == "joint" else d  # whose bins are k^d
    usual = {"n_steps": 16, "n_envs": 2, "n_bins": 21, "learning_rate": 3e-3} | OWN.get(algorithm, {})
    model = galton.Model(
        lambda: Drifting(LOW[:d], HIGH[:d]), loss, algorithm=algorithm, policy=policy, seed=1, **usual | settings
    )
    return model.learn(steps, progress_bar=False)


def states(n, size, seed=0):
    """Small and large ones: their scales are spread evenly from a hundredth to ten thousand."""
    rng = np.random.default_rng(seed)
    return (rng.normal(size=(n, size)) * 10 ** rng.uniform(-2, 4, (n, 1))).astype(np.float32)
