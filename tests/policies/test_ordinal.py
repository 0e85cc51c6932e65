"""The ordinal softmax against the form in which Tang & Agrawal (2020) write it."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.special import log_expit, softmax
from scipy.stats import norm

from galton import LOSSES
from galton.parts import Box
from galton.policies import HistogramPolicy, OrdinalPolicy

LOW, HIGH, K = np.array([-1.0, 0.0]), np.array([1.0, 5.0]), 7
HISTOGRAM = [name for name, loss in LOSSES.items() if loss.family == "histogram"]


def policy(**fields):
    return OrdinalPolicy(n_bins=K, **fields).on(Box.of(LOW, HIGH))


def test_probabilities_are_the_stick_forms():
    outputs = 2 * jax.random.normal(jax.random.key(0), (5, 3, 2 * K))
    f = np.asarray(outputs, np.float64).reshape(5, 3, 2, K)
    up, down = log_expit(f), log_expit(-f)
    logits = np.stack([up[..., : i + 1].sum(-1) + down[..., i + 1 :].sum(-1) for i in range(K)], -1)
    distribution = policy().distribution(outputs, {})
    np.testing.assert_allclose(distribution.probs, softmax(logits, -1), rtol=1e-5, atol=1e-7)
    action = distribution.bins.decode(jax.random.randint(jax.random.key(1), (5, 3, 2), 0, K))
    expected = np.take_along_axis(
        np.log(softmax(logits, -1)), np.asarray(distribution.bins.encode(action))[..., None], -1
    )
    np.testing.assert_allclose(distribution.log_prob(action), expected.sum((-2, -1)), rtol=1e-5)


def test_an_output_moves_every_bin_at_and_above_its_own_by_the_same_factor():
    before, after = (policy().distribution(jnp.zeros(2 * K).at[3].set(x), {}).probs[0] for x in (0.0, 1.0))
    ratio = np.asarray(after / before)
    np.testing.assert_allclose(ratio[3:] / ratio[0], np.e, rtol=1e-5)
    np.testing.assert_allclose(ratio[:3], ratio[0], rtol=1e-6)


def test_it_starts_uniform():
    outputs, params = policy().init()
    assert params == {}
    np.testing.assert_allclose(policy().distribution(outputs, {}).probs, 1 / K, rtol=1e-6)


def test_init_gaussian_starts_like_the_softmax_policy_which_starts_like_the_gaussian():
    box = Box.of(np.array([-4.0]), np.array([4.0]))
    kinds = (OrdinalPolicy, HistogramPolicy)
    ordinal, plain = (kind(n_bins=400, initial_policy="gaussian").on(box) for kind in kinds)
    probs = ordinal.distribution(ordinal.init()[0], {}).probs[0]
    expected = np.diff(norm.cdf(np.linspace(-4, 4, 401)))
    np.testing.assert_allclose(probs, expected / expected.sum(), atol=2e-6)
    np.testing.assert_allclose(probs, plain.distribution(plain.init()[0], {}).probs[0], rtol=1e-3)


@pytest.mark.slow
def test_everything_but_the_logits_is_the_softmax_policys():
    ordinal = policy(bin_sample="uniform", exploration="softmax", deterministic_action="mean")
    plain = HistogramPolicy(n_bins=K, bin_sample="uniform", deterministic_action="mean").on(Box.of(LOW, HIGH))
    outputs = jax.random.normal(jax.random.key(2), (4, 2 * K))
    ours = ordinal.distribution(outputs, {})
    sums = jnp.cumsum(outputs.reshape(4, 2, K), -1).reshape(4, 2 * K)
    theirs = plain.distribution(sums, {})
    noise = ordinal.noise(jax.random.key(3), (4,))
    np.testing.assert_array_equal(noise, plain.noise(jax.random.key(3), (4,)))
    np.testing.assert_array_equal(ours.sample(noise), theirs.sample(noise))
    np.testing.assert_array_equal(ours.deterministic_action(), theirs.deterministic_action())
    assert ordinal.n_outputs == plain.n_outputs == 2 * K


@pytest.mark.slow
@pytest.mark.parametrize("scale", [0.0, 1.0, 30.0])
@pytest.mark.parametrize("loss", HISTOGRAM)
def test_the_gradient_of_every_histogram_loss_is_finite(loss, scale):
    outputs = scale * jax.random.normal(jax.random.key(4), (16, 2 * K))
    action = policy().distribution(jnp.zeros_like(outputs), {}).sample(policy().noise(jax.random.key(5), (16,)))

    def total(outputs):
        return LOSSES[loss]()(policy().distribution(outputs, {}), action).sum()

    gradient = np.asarray(jax.grad(total)(outputs))
    assert np.isfinite(gradient).all()
    assert np.abs(gradient).max() > 1e-3
    # The constant that the first output adds to all logits has no part in the loss.
    np.testing.assert_allclose(gradient.reshape(16, 2, K)[..., 0], 0, atol=1e-4)
