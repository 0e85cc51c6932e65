import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.stats import multivariate_normal

from galton import LOSSES, Bins, UsageError, losses, targets
from galton.policies import Gaussian, Histogram
from galton.policies.histogram import Choices

from .agents import agent

HISTOGRAM = [name for name, loss in LOSSES.items() if loss.family == "histogram"]
BINS = Bins([-1.0, 0.0], [1.0, 5.0], 30)
K, D = 30, 2


def batch(seed=0, n=8):
    keys = jax.random.split(jax.random.key(seed), 3)
    logits = 2 * jax.random.normal(keys[0], (n, D, K))
    action = Bins([-1.0, 0.0], [1.0, 5.0], K).decode(jax.random.randint(keys[1], (n, D), 0, K))
    return logits, action, jax.random.normal(keys[2], (n,))


def gradient(name, logits, action, advantage, eta):
    """Of Σ_j A_j loss_j in the logits."""

    def total(logits):
        distribution = Histogram(Bins([-1.0, 0.0], [1.0, 5.0], K), logits)
        loss = agent({"loss": name, "eta": eta}).loss(distribution, action)
        return losses.surrogate(advantage, loss) * len(advantage)

    return jax.grad(total)(logits)


@pytest.mark.parametrize("eta", [0.1, 0.75, 3.0])
def test_the_gradient_in_the_logits_is_the_papers(eta):
    with jax.enable_x64(True):
        bins = Bins([-1.0, 0.0], [1.0, 5.0], K)
        logits, action, advantage = batch()
        pi = jax.nn.softmax(logits)
        q = targets.hl_gauss(bins, action, eta)
        weight = advantage[:, None, None]
        for name, expected in {
            "hl-one-hot": weight * (targets.one_hot(bins, action) - pi),
            "hl-gauss": weight * (q - pi),
            "hl-gauss-centred": weight * (q - pi @ targets.hl_gauss_of_center(K, jnp.arange(K), eta)),
        }.items():
            # The paper ascends, we minimise.
            np.testing.assert_allclose(-gradient(name, logits, action, advantage, eta), expected, atol=1e-10)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "indifferent"), [("hl-one-hot", True), ("hl-gauss", False), ("hl-gauss-centred", True)]
)
def test_mean_gradient_over_actions_under_a_shifted_advantage(name, indifferent):
    with jax.enable_x64(True):
        bins = Bins(-1.0, 1.0, K)
        logits = jax.random.normal(jax.random.key(1), (K,))
        pi = jax.nn.softmax(logits)
        actions = jnp.asarray(bins.centers.T)[:, None]

        def mean_gradient(shift):
            advantage = jnp.sin(jnp.arange(K)) + shift

            def expected_loss(logits):
                distribution = Histogram(bins, jnp.tile(logits, (K, 1, 1)))
                loss = agent({"loss": name, "eta": 0.75}).loss(distribution, actions[:, 0])
                return jnp.sum(pi * advantage * loss)

            return jax.grad(expected_loss)(logits)

        moved = float(jnp.abs(mean_gradient(7.0) - mean_gradient(0.0)).max())
        assert moved < 1e-12 if indifferent else moved > 1e-3


@pytest.mark.slow
def test_centred_hl_gauss_with_a_narrow_target_is_hl_one_hot():
    logits, action, advantage = batch()
    np.testing.assert_allclose(
        gradient("hl-gauss-centred", logits, action, advantage, 0.01),
        gradient("hl-one-hot", logits, action, advantage, 0.01),
        atol=1e-5,
    )


@pytest.mark.parametrize("name", HISTOGRAM)
@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_near_a_uniform_policy_the_advantages_sign_is_the_direction_of_the_actions_probability(name, sign):
    logits, action, _ = batch()
    logits = 0.1 * logits
    step = logits - 0.1 * gradient(name, logits, action, jnp.full(len(logits), sign), 0.5)
    index = BINS.encode(action)[..., None]
    before = jnp.take_along_axis(jax.nn.softmax(logits), index, -1)
    after = jnp.take_along_axis(jax.nn.softmax(step), index, -1)
    assert (sign * (after - before) > 0).all()


@pytest.mark.slow
@settings(max_examples=50)
@given(st.integers(0, 2**31 - 1), st.floats(0.01, 4))
def test_target_and_policy_differ_by_at_most_two(seed, eta):
    logits, action, _ = batch(seed, n=4)
    q = targets.hl_gauss(BINS, action, eta)
    assert float(jnp.abs(q - jax.nn.softmax(20 * logits)).sum(-1).max()) <= 2 + 1e-5


def test_the_gaussian_loss_is_the_negative_log_likelihood():
    with jax.enable_x64(True):
        mean, log_std, action = jnp.array([[0.3, -2.0]]), jnp.array([0.5, -1.0]), jnp.array([[1.0, -1.5]])
        loss = losses.NegativeLogLikelihood()(Gaussian(mean, log_std, BINS.low, BINS.high), action)
        expected = -multivariate_normal(mean[0], np.diag(np.exp(2 * np.asarray(log_std)))).logpdf(action[0])
        np.testing.assert_allclose(loss, [expected], rtol=1e-12)


@pytest.mark.parametrize("choice", [{"exploration": "gaussian"}, {"bin_sample": "uniform"}])
def test_off_center_actions_get_the_target_around_themselves(choice):
    logits, action, _ = batch()
    action = action + 0.3 * BINS.width
    distribution = Histogram(BINS, logits, Choices(**choice))
    loss = losses.HLGauss(eta=0.75)(distribution, action)
    expected = -(targets.hl_gauss(BINS, action, 0.75) * jax.nn.log_softmax(logits)).sum((-1, -2))
    np.testing.assert_allclose(loss, expected, rtol=1e-5)


def test_no_gradient_flows_through_the_advantage():
    assert float(jax.grad(lambda a: losses.surrogate(a, jnp.full(3, 2.0)))(jnp.ones(3)).sum()) == 0


def test_an_unknown_loss_is_named():
    with pytest.raises(UsageError, match="loss is 'ppo'; choose from gaussian"):
        losses.find_loss("ppo")
