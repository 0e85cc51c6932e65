"""A Gaussian whose σ leaves the action box behind is told of, once, with what helps."""

import warnings

import pytest

from galton import PPO, WideGaussian
from galton.envs import Bandit

SMALL = {"n_steps": 16, "batch_size": 8, "net_arch": (), "box_units": 1.0}
TOLD = r"^at step [\d,]+ the Gaussian's σ has grown to .* lower ent_coef, which is 1,"


@pytest.mark.slow
def test_a_sigma_that_outgrows_the_box_is_said_once_and_a_policy_that_stays_in_it_is_not_warned_of():
    with pytest.warns(WideGaussian, match=TOLD) as told:
        PPO(Bandit(), "gaussian", **SMALL, learning_rate=0.1, ent_coef=1.0).learn(16 * 8)
    assert len(told) == 1
    with warnings.catch_warnings():
        warnings.simplefilter("error", WideGaussian)
        for loss in ("gaussian", "hl-gauss"):
            PPO(Bandit(), loss, **SMALL, learning_rate=1e-3).learn(16 * 8)
