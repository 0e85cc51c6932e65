"""A divergence names what was too large, and never tells to set what is set."""

import numpy as np
import pytest

from galton import DivergenceError
from galton.normalization import Moments, Normalizer
from galton.training.remedy import remedy
from galton.types import Learner

from ..agents import agent

FINE = Moments(np.zeros(2), np.ones(2), np.float32(9))


def told(low=-1.0, observation=(), reward=(), **words):
    made = agent({"loss": "gaussian", **words}, low=[low, -1.0], high=[1.0, 1.0])
    return remedy(made, Learner({}, (), Normalizer(observation, reward, ()), {}))


CAUSES = [
    ({}, "^Lower learning_rate, or set normalize_reward, or set normalize_observation$"),
    ({"normalize_reward": True}, "^Lower learning_rate, or set normalize_observation$"),
    ({"normalize_observation": True, "normalize_reward": True}, "^Lower learning_rate$"),
    ({"observation": FINE, "reward": FINE, "normalize_reward": True}, "^Lower learning_rate, or set normalize_obs"),
    ({"low": -1e38}, r"^The action box is 1\.0e\+38 wide, .*RescaleAction"),
    ({"low": -3e18}, r"^The action box is 3\.0e\+18 wide"),
    ({"low": -1e6}, "^Lower learning_rate"),
    ({"observation": FINE._replace(variance=np.array([1, np.inf]))}, "^The observations are so large .*Transform"),
    ({"observation": FINE._replace(mean=np.array([np.nan, 1]))}, "^The observations are so large"),
    ({"observation": FINE, "reward": FINE._replace(variance=np.float32(np.inf))}, "^The rewards are so large"),
    ({"low": -1e38, "reward": FINE._replace(variance=np.float32(np.nan))}, "^The rewards are so large"),
]


@pytest.mark.parametrize(("facts", "message"), CAUSES)
def test_the_remedy_fits_the_cause(facts, message):
    with pytest.raises(DivergenceError, match=message):
        raise DivergenceError(told(**facts))
