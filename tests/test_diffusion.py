"""The diffusion bonus moves logits along Kᵀπ − π, also where a policy is certain and an entropy bonus does nothing."""

import jax
import numpy as np
import pytest
import scipy.special

import galton
from galton import targets
from galton.algorithms import actor_critic
from galton.bins import Bins
from galton.losses import HLGauss, HLGaussCentred
from galton.parts import Box
from galton.policies.histogram import Histogram

K, ETA, BETA = 12, 2.0, 0.3
BINS = Bins(np.array([-1.0]), np.array([1.0]), K)


@pytest.mark.parametrize("kind", [HLGauss, HLGaussCentred])
def test_its_gradient_in_the_logits_is_the_policy_less_the_expected_target(kind):
    with jax.enable_x64(True):
        logits = np.random.default_rng(0).normal(size=(1, K)) * 3
        loss = kind(eta=ETA, target_tails="reflected", diffusion=BETA)
        found = jax.grad(lambda logits: loss.regularizer(Histogram(BINS, logits)))(logits)[0]
        probs = scipy.special.softmax(logits[0])
        of_rows = np.asarray(targets.hl_gauss_of_center(K, np.arange(K), ETA, "reflected"))
        np.testing.assert_allclose(found, BETA * (probs - of_rows.T @ probs), atol=1e-14)


def test_it_reaches_a_policy_that_is_certain():
    certain = np.where(np.arange(K) == 4, 200.0, 0.0)[None]
    loss = HLGauss(eta=ETA, target_tails="reflected", diffusion=BETA)
    spread = -jax.grad(lambda logits: loss.regularizer(Histogram(BINS, logits)))(certain)[0]
    entropy = jax.grad(lambda logits: Histogram(BINS, logits).entropy())(certain)[0]
    assert spread[5] > 0.05 * BETA
    assert np.abs(entropy).max() < 1e-30


def test_it_is_a_part_of_the_objective_where_it_is_not_zero():
    def total(**settings):
        agent = galton.make_agent(loss="hl-gauss", n_bins=K, net_arch=(8,), eta=ETA, **settings).on(
            Box((-1.0,), (1.0,))
        )
        learner = actor_critic.init(jax.random.key(0), agent, 3)
        distribution = actor_critic.distribution(agent, learner.params, np.ones((5, 3), np.float32))
        zeros = np.zeros(5, np.float32)
        bonus = agent.loss.regularizer(distribution)
        return actor_critic.objective(agent, learner, distribution, zeros, zeros, zeros).total, bonus

    (without, none), (with_it, bonus) = total(), total(diffusion=BETA)
    assert none is None
    np.testing.assert_allclose(with_it - without, np.mean(bonus), rtol=1e-5)
    assert bonus.shape == (5,)


@pytest.mark.parametrize("beta", [-0.1, np.inf])
def test_it_is_zero_or_more(beta):
    with pytest.raises(galton.UsageError, match=r"diffusion is .*; it must be finite, and 0 or more"):
        HLGauss(diffusion=beta)
