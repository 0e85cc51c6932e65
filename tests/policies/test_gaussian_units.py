"""The numbers that decide how a Gaussian explores: its first σ, a floor under it, and the units it is in."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from galton.parts import Box
from galton.policies import GaussianPolicy

LOW, HIGH = np.array([-3.0, 2.0]), np.array([1.0, 2.5])
CENTER, HALF = (HIGH + LOW) / 2, (HIGH - LOW) / 2
OUTPUTS = jnp.array([[0.3, -0.8], [1.7, 0.1], [0.0, 0.0]])
LOG_STD = jnp.array([-0.4, 0.2])


def policy(low=LOW, high=HIGH, **numbers):
    return GaussianPolicy(box=Box.of(low, high), **numbers)


def in_box(**numbers):
    return policy(box_units=1.0, **numbers).distribution(OUTPUTS, {"log_std": LOG_STD})


def in_unit_box(**numbers):
    unit = policy(np.full(2, -1.0), np.ones(2), **numbers)
    return unit.distribution(OUTPUTS, {"log_std": LOG_STD})


@pytest.mark.parametrize("box_units", [0.0, 1.0])
@pytest.mark.parametrize("log_std_init", [-2.0, 0.0, 0.7])
def test_it_starts_at_the_sigma_that_log_std_init_says(log_std_init, box_units):
    ours = policy(log_std_init=log_std_init, box_units=box_units)
    bias, params = ours.init()
    distribution = ours.distribution(jnp.asarray(bias), params)
    np.testing.assert_allclose(distribution.mean, CENTER * box_units, atol=1e-6)
    np.testing.assert_allclose(distribution.std(), np.exp(log_std_init) * np.where(box_units, HALF, 1), rtol=1e-6)


def test_sigma_is_never_below_the_floor_and_has_no_gradient_there():
    floored, action = policy(log_std_min=-1.0), jnp.array([0.2, 2.2])

    def log_prob(log_std):
        return floored.distribution(jnp.zeros(2), {"log_std": log_std}).log_prob(action)

    for below in (-1.5, -40.0):
        params = {"log_std": jnp.array([below, -0.5])}
        std = floored.distribution(jnp.zeros(2), params).std()
        np.testing.assert_allclose(std, np.exp([-1.0, -0.5]), rtol=1e-6)
        gradient = jax.grad(log_prob)(params["log_std"])
        assert gradient[0] == 0
        assert gradient[1] != 0
    above = jnp.array([-0.9, 0.3])
    free = jax.grad(lambda x: policy().distribution(jnp.zeros(2), {"log_std": x}).log_prob(action))(above)
    np.testing.assert_array_equal(jax.grad(log_prob)(above), free)


def test_without_a_floor_sigma_falls_as_far_as_it_likes():
    std = policy().distribution(jnp.zeros(2), {"log_std": jnp.array([-30.0, -60.0])}).std()
    np.testing.assert_allclose(std, np.exp([-30.0, -60.0]), rtol=1e-5)


@pytest.mark.parametrize("log_std_min", [-np.inf, 0.1])
def test_in_units_of_the_box_it_is_the_policy_of_the_unit_box_scaled_by_hand(log_std_min):
    ours, theirs = in_box(log_std_min=log_std_min), in_unit_box(log_std_min=log_std_min)
    noise = policy().noise(jax.random.key(0), (3,))
    for found, unit in (
        (ours.sample(noise), theirs.sample(noise)),
        (ours.mean, theirs.mean),
        (ours.deterministic_action(), theirs.deterministic_action()),
    ):
        np.testing.assert_allclose(found, CENTER + HALF * unit, rtol=1e-5, atol=1e-6)
    np.testing.assert_allclose(ours.std(), HALF * theirs.std(), rtol=1e-5)
    np.testing.assert_array_equal(ours.at_edge(ours.sample(noise)), theirs.at_edge(theirs.sample(noise)))


def test_log_prob_and_entropy_follow_the_change_of_variables():
    action = in_unit_box().sample(policy().noise(jax.random.key(1), (3,)))
    volume = np.log(HALF).sum()
    scaled = CENTER + HALF * action
    np.testing.assert_allclose(in_box().log_prob(scaled), in_unit_box().log_prob(action) - volume, rtol=1e-4, atol=1e-5)
    np.testing.assert_allclose(in_box().entropy(), in_unit_box().entropy() + volume, rtol=1e-5)


@pytest.mark.parametrize("box_units", [0.0, 1.0])
def test_a_mean_of_tanh_stays_in_the_box_and_sigma_keeps_its_units(box_units):
    numbers = {"box_units": box_units, "log_std_min": -0.1}
    plain, ours = (
        policy(tanh_mean=tanh, **numbers).distribution(OUTPUTS, {"log_std": LOG_STD}) for tanh in (False, True)
    )
    np.testing.assert_allclose(ours.mean, CENTER + HALF * np.tanh(OUTPUTS), rtol=1e-5, atol=1e-6)
    np.testing.assert_array_equal(ours.std(), plain.std())


def test_the_environments_units_do_not_depend_on_the_box():
    for other in (policy(), policy(np.full(2, -1.0), np.ones(2))):
        distribution = other.distribution(OUTPUTS, {"log_std": LOG_STD})
        np.testing.assert_array_equal(distribution.mean, OUTPUTS)
        np.testing.assert_allclose(distribution.std(), np.tile(np.exp(LOG_STD), (3, 1)), rtol=1e-6)
