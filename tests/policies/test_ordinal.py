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
    rng = np.random.default_rng(0)
    outputs = 2 * rng.normal(size=(5, 3, 2 * K)).astype(np.float32)
    f = outputs.reshape(5, 3, 2, K).astype(np.float64)
    up, down = log_expit(f), log_expit(-f)
    logits = np.stack([up[..., : i + 1].sum(-1) + down[..., i + 1 :].sum(-1) for i in range(K)], -1)
    index = rng.integers(0, K, (5, 3, 2))
    action = policy().bins.centers[np.arange(2), index]

    @jax.jit
    def tell(outputs, action):
        distribution = policy().distribution(outputs, {})
        return distribution.probs, distribution.log_prob(action), policy().distribution(policy().init()[0], {}).probs

    probs, log_prob, first = tell(outputs, action)
    np.testing.assert_allclose(probs, softmax(logits, -1), rtol=1e-5, atol=1e-7)
    expected = np.take_along_axis(np.log(softmax(logits, -1)), index[..., None], -1)
    np.testing.assert_allclose(log_prob, expected.sum((-2, -1)), rtol=1e-5)
    np.testing.assert_allclose(first, 1 / K, rtol=1e-6)  # it starts uniform


def test_init_gaussian_starts_like_the_softmax_policy_which_starts_like_the_gaussian():
    box = Box.of(np.array([-4.0]), np.array([4.0]))
    kinds = (OrdinalPolicy, HistogramPolicy)
    ordinal, plain = (kind(n_bins=400, initial_policy="gaussian").on(box) for kind in kinds)
    probs, plains = jax.jit(lambda: [one.distribution(one.init()[0], {}).probs[0] for one in (ordinal, plain)])()
    expected = np.diff(norm.cdf(np.linspace(-4, 4, 401)))
    np.testing.assert_allclose(probs, expected / expected.sum(), atol=2e-6)
    np.testing.assert_allclose(probs, plains, rtol=1e-3)


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
