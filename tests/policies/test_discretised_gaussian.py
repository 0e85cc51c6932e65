"""The Gaussian on bins, alone and with residuals, against its definition in float64."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.special import log_softmax

from galton import UsageError
from galton.policies import Histogram

from ..agents import agent

LOW, HIGH, K = np.array([-1.0, 2.0], np.float32), np.array([1.0, 6.0], np.float32), 41
WORDS = {"loss": "hl-one-hot", "n_bins": K}


def policy_of(name, **words):
    return agent(WORDS | {"policy": name, **words}, low=LOW, high=HIGH).policy


def by_definition(mean, std):
    centers = LOW[:, None] + (np.arange(K) + 0.5) / K * (HIGH - LOW)[:, None]
    return log_softmax(-((centers - mean[..., None]) ** 2) / (2 * std[:, None] ** 2), -1), centers


@pytest.mark.parametrize("box_units", [0.0, 1.0])
def test_it_is_the_density_at_the_centers_scaled_to_sum_to_one(box_units):
    policy = policy_of("discretised-gaussian", box_units=box_units, log_std_init=-1.0)
    first, params = policy.init()
    outputs = jnp.asarray(np.random.default_rng(0).normal(size=(6, 2)).astype(np.float32) * 2)
    shift, scale = ((HIGH + LOW) / 2, (HIGH - LOW) / 2) if box_units else (0.0, 1.0)
    expected, centers = by_definition(shift + scale * np.asarray(outputs), np.exp(-1) * scale * np.ones(2))
    found = policy.distribution(outputs, params)
    np.testing.assert_allclose(jax.nn.log_softmax(found.logits), expected, rtol=1e-4, atol=1e-4)
    assert first.shape == outputs.shape[1:]

    action = jnp.asarray(centers[:, 7], jnp.float32)
    slope = jax.grad(lambda mean: policy.distribution(mean, params).log_prob(action))(outputs[0])
    apart = centers[:, 7] - (np.exp(expected[0]) * centers).sum(-1)
    np.testing.assert_allclose(slope, apart / scale / np.exp(-1) ** 2, rtol=1e-3)


@pytest.mark.parametrize("far", [0.5, 3.0, 300.0])
def test_three_sums_tell_what_the_array_of_logits_would(far):
    rng = np.random.default_rng(2)
    policy = policy_of("discretised-gaussian", log_std_init=-1.0, box_units=1.0, bin_centers="bounds")
    mean = jnp.asarray(far * rng.normal(size=(9, 2)), jnp.float32)
    index = jnp.asarray(rng.integers(K, size=(9, 2)))
    action = policy.bins.decode(index)

    def told(mean, log_std):
        found = policy.distribution(mean, {"log_std": log_std})
        return found.log_prob(action), found.log_prob_of_bins(action), found.entropy()

    def defined(mean, log_std):
        centers = np.linspace(-1.0, 1.0, K)
        log_probs = jax.nn.log_softmax(-0.5 * ((centers - mean[..., None]) / jnp.exp(log_std)[:, None]) ** 2)
        of_action = jnp.take_along_axis(log_probs, index[..., None], -1).sum((-2, -1))
        return of_action, of_action, -(jnp.exp(log_probs) * log_probs).sum((-2, -1))

    log_std = policy.init()[1]["log_std"] + jnp.array([-0.5, 1.0])
    with jax.enable_x64(True):
        exact = [x.astype(jnp.float64) for x in (mean, log_std)]
        expected = defined(*exact), jax.jacobian(lambda *x: jax.tree.map(jnp.sum, defined(*x)), (0, 1))(*exact)
    found = told(mean, log_std), jax.jacobian(lambda *x: jax.tree.map(jnp.sum, told(*x)), (0, 1))(mean, log_std)
    for ours, theirs in zip(jax.tree.leaves(found), jax.tree.leaves(expected), strict=True):
        np.testing.assert_allclose(ours, theirs, rtol=2e-5, atol=2e-5 * max(1.0, abs(np.asarray(theirs)).max()))


def test_an_action_that_is_no_center_has_the_likelihood_of_its_bin():
    policy = policy_of("discretised-gaussian", log_std_init=-1.0)
    found = policy.distribution(jnp.array([[0.3, 3.0], [-0.2, 5.0]]), policy.init()[1])
    action = jnp.array([[0.17, 2.03], [1.4, 9.0]])
    expected = Histogram(found.bins, found.logits).log_prob(action)
    np.testing.assert_allclose(found.log_prob(action), expected, rtol=1e-4)


@pytest.mark.parametrize("log_std", [-10.0, -14.0, -20.0])
def test_far_narrower_than_a_bin_it_has_finite_numbers(log_std):
    policy = policy_of("discretised-gaussian", n_bins=100, log_std_init=log_std, box_units=1.0)
    log_std, mean = policy.init()[1]["log_std"], jnp.array([0.005, 0.306])

    def told(mean, log_std):
        found = policy.distribution(mean, {"log_std": log_std})
        return found.log_prob(found.deterministic_action()) + found.entropy()

    found = told(mean, log_std), *jax.grad(told, (0, 1))(mean, log_std)
    np.testing.assert_allclose(found[0], 0, atol=1e-6)
    assert all(np.isfinite(x).all() for x in found)


def test_a_mean_beyond_the_box_puts_its_mass_on_the_last_bin():
    policy = policy_of("discretised-gaussian", log_std_init=-2.0)
    found = policy.distribution(jnp.array([5.0, -9.0]), policy.init()[1])
    np.testing.assert_allclose([found.probs[0, -1], found.probs[1, 0]], 1, atol=1e-4)


def test_with_residuals_it_starts_there_and_may_take_any_shape():
    rng = np.random.default_rng(1)
    plain, policy = policy_of("discretised-gaussian"), policy_of("anchored", residual_scale=0.5)
    params, mean, free = plain.init()[1], rng.normal(size=(3, 2, 1)), rng.normal(size=(3, 2, K))
    np.testing.assert_array_equal(policy.init()[0], np.zeros(2 * (K + 1)))
    outputs = jnp.asarray(np.concatenate([free, mean], -1).reshape(3, -1), jnp.float32)
    found = policy.distribution(outputs, params).logits
    gaussian = plain.distribution(jnp.asarray(mean[..., 0], jnp.float32), params).logits
    np.testing.assert_allclose(found, gaussian + 0.5 * free, rtol=1e-5, atol=1e-4)


@pytest.mark.parametrize("name", ["discretised-gaussian", "anchored"])
def test_it_has_no_first_policy_to_choose(name):
    with pytest.raises(UsageError, match=r"initial_policy is 'clipped-gaussian'; it goes with policy 'histogram', "):
        policy_of(name, initial_policy="clipped-gaussian")
