"""PPO with each choice beside the loss: in its first minibatch A2C, later its own clipped surrogate. In float64."""

import itertools

import jax.numpy as jnp
import numpy as np
import pytest

from galton.algorithms import ppo

from .minibatches import agent_of, check_equal, check_the_first_minibatch_is_a2cs
from .test_ppo_gradients import clipped_surrogates_gradient, deep, gradient

pytestmark = pytest.mark.usefixtures("double")

CHOICES = {
    "awr": {"weighting": "awr"},
    "v-mpo": {"weighting": "v-mpo", "normalize_advantage": True},
    "split": {"negative_target": "one-hot"},
    "split, normalised": {"negative_target": "one-hot", "normalize_advantage": True},
    "width": {"eta_rule": "policy"},
    "width, split, held": {"eta_rule": "policy", "negative_target": "one-hot", "entropy_target": True},
    "held, v-mpo": {"entropy_target": True, "weighting": "v-mpo"},
}


def words_of(name, ratio):
    """What an agent with one of CHOICES is made with."""
    temperature = {"temperature": 0.7} if "weighting" in CHOICES[name] else {}
    return {"eta": 1.0, "ratio": ratio} | temperature | CHOICES[name]


ALL = list(itertools.product(CHOICES, [("hl-gauss", "smoothed"), ("hl-gauss-centred", "true")]))
ALL += list(itertools.product(CHOICES, [("hl-gauss", "true"), ("hl-gauss-centred", "smoothed")]))


@pytest.mark.few
@pytest.mark.parametrize(("name", "kind"), ALL)
def test_the_first_minibatch_of_the_first_epoch_is_a2cs(name, kind):
    loss, ratio = kind
    after, a2cs = check_the_first_minibatch_is_a2cs(agent_of("histogram", loss, **words_of(name, ratio)))
    assert after.memory["entropy"] == a2cs.memory["entropy"]


CLIPPED = list(itertools.product(["awr", "split", "split, normalised"], ["smoothed", "true"]))


@pytest.mark.slow
@pytest.mark.parametrize(("name", "ratio"), CLIPPED)
def test_the_gradient_is_that_of_the_clipped_surrogate_of_these_weights_and_targets(name, ratio):
    given = deep("histogram", "hl-gauss", **words_of(name, ratio))
    found, told = gradient(*given)
    assert 0 < told["clip_fraction"] < 1
    check_equal(found, clipped_surrogates_gradient(*given), 1e-9)


def test_a_positive_weight_is_never_clipped_from_below():
    ratio, weight = jnp.array([0.01, 0.85, 1.0, 1.15, 1.5]), jnp.full(5, 0.3)
    np.testing.assert_array_equal(ppo.gated(ratio, weight, 0.2), [0.01, 0.85, 1.0, 1.15, 0.0])
