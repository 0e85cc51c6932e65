"""Environments for the tests of vector environments, and vectors of them."""

import numpy as np
from gymnasium.spaces import Box, Dict, Discrete
from gymnasium.vector import AutoresetMode, SyncVectorEnv
from gymnasium.wrappers import TimeLimit

from . import walks
from .walks import N


class Walk(walks.Walk):
    """Ends beyond ±2, so that the copies' episodes end at different steps."""

    action_space = Box(-1, 1, (2,))

    def ends(self):
        return abs(self.position) > 2


class Named(Walk):
    observation_space = Dict(z=Box(-np.inf, np.inf, ()), a=Discrete(100))

    def observe(self):
        return {"z": np.array(self.position, np.float32), "a": self.t}


def limited(env):
    return lambda: TimeLimit(env(), 4)


def sync(env, mode=AutoresetMode.SAME_STEP):
    return SyncVectorEnv([limited(env)] * N, autoreset_mode=mode)
