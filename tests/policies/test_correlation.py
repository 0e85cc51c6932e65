"""Correlated noise: each step's distribution as without it, the correlation that was asked for, and no other."""

import functools
import math

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy import stats

import galton
from galton import POLICIES, UsageError
from galton.parts import Box, settings
from galton.policies import Correlatable, GaussianPolicy, HistogramPolicy, Policy
from galton.policies.correlation import check_correlation, continued, nothing_before
from galton.policies.gaussian import Floor, Units
from galton.types import Finite

BOX = Box.of(np.array([-1.0, 0.0]), np.array([1.0, 5.0]))
N, T = 4_000, 12
KINDS = {
    "normal": GaussianPolicy(),
    "uniform": HistogramPolicy(n_bins=7),
    "uniform, two a dimension": HistogramPolicy(n_bins=7, bin_sample="uniform"),
    "where a Gaussian explores": HistogramPolicy(n_bins=7, exploration="gaussian"),
}


def policy_of(kind):
    return KINDS[kind].on(BOX)


@functools.cache
def program_of(kind):
    policy = policy_of(kind)

    @jax.jit
    def run(rho, begins):
        drawn = policy.noise(jax.random.key(0), begins.shape)

        def step(z, inputs):
            x, first = inputs
            noise, z = continued(policy, x, z, first, rho)
            return z, noise

        return jax.lax.scan(step, nothing_before(policy, begins.shape[1:], rho), (drawn, begins))[1], drawn

    return run


def noises(kind, rho, *starts):
    """The noise of T steps of N copies whose episodes begin at these, and what was drawn, each `[T, N, n]`."""
    begins = np.zeros((T, N), bool)
    begins[list(starts)] = True
    return [np.asarray(each, np.float64) for each in program_of(kind)(np.float32(rho), begins)]


@functools.cache
def episodes(kind, rho):
    """N episodes that begin together."""
    return noises(kind, rho, 0)[0]


def distribution_of(kind):
    return "norm" if policy_of(kind).noise_marginals == "normal" else "uniform"


def normal_numbers(kind, noise):
    return noise if distribution_of(kind) == "norm" else stats.norm.ppf(noise)


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("rho", [0.5, 0.97])
def test_in_each_step_noise_is_distributed_as_without_correlation(kind, rho):
    noise = episodes(kind, rho)
    for t in (0, 1, 5, T - 1):
        for entries in noise[t].T:
            assert stats.kstest(entries, distribution_of(kind)).pvalue > 1e-3


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("rho", [0.5, 0.97])
def test_steps_k_apart_have_the_correlation_rho_to_the_k_and_entries_have_none(kind, rho):
    z = normal_numbers(kind, episodes(kind, rho))
    for k in (1, 2, 5, 10):
        for one, other in zip(z[1].T, z[1 + k].T, strict=True):
            found = np.corrcoef(one, other)[0, 1]
            assert abs(found - rho**k) < 4 * (1 - rho ** (2 * k)) / np.sqrt(N)
    across = np.corrcoef(z.transpose(2, 0, 1).reshape(z.shape[2], -1))  # neighbours in time are no new evidence
    assert abs(across - np.eye(len(across))).max() < 4 / np.sqrt(N)


@pytest.mark.parametrize("kind", KINDS)
def test_an_episode_begins_with_noise_that_knows_nothing_of_the_one_before(kind):
    noise, drawn = noises(kind, 0.97, 0, 2)
    z = normal_numbers(kind, noise)
    assert np.corrcoef(z[0].ravel(), z[1].ravel())[0, 1] > 0.9
    assert abs(np.corrcoef(z[1].ravel(), z[2].ravel())[0, 1]) < 4 / np.sqrt(z[0].size)
    assert np.corrcoef(z[2].ravel(), z[3].ravel())[0, 1] > 0.9
    np.testing.assert_allclose(noise[2], drawn[2], atol=1e-6)


@pytest.mark.few
@pytest.mark.parametrize("kind", KINDS)
def test_a_run_without_correlation_beside_one_with_it_has_what_was_drawn_to_the_bit(kind):
    noise, drawn = noises(kind, 0.0, 0)
    np.testing.assert_array_equal(noise, drawn)
    assert (episodes(kind, 0.5)[1:] != drawn[1:]).mean() > 0.999


@pytest.mark.slow
def test_the_ends_of_the_uniform_numbers_stay_inside_and_are_not_kept():
    policy = policy_of("uniform")
    ends = jnp.array([[0.0, 1 - 2**-23], [1e-7, 0.5]], jnp.float32)
    begins = jnp.array([True, True])
    noise, z = continued(policy, ends, jnp.zeros((2, 2)), begins, jnp.float32(0.9))
    np.testing.assert_allclose(z, stats.norm.ppf(np.asarray(ends, np.float64) + 2**-24), atol=2e-4)
    assert ((noise >= 0) & (noise < 1)).all()
    far, z = continued(policy, ends, jnp.full((2, 2), 30.0), ~begins, jnp.float32(0.9))
    assert ((far >= 0) & (far < 1)).all()
    assert np.isfinite(z).all()


def test_without_correlation_there_is_no_state_and_nothing_is_touched():
    policy = policy_of("normal")
    assert nothing_before(policy, (3,), None) == ()
    drawn = policy.noise(jax.random.key(0), (3,))
    noise, after = continued(policy, drawn, (), (), None)
    assert noise is drawn
    assert after == ()


class Silent(Policy):
    """The Gaussian policy without a word on its noise."""

    log_std_init: Finite = 0.0
    log_std_min: Floor = -math.inf
    box_units: Units = 0.0

    n_outputs, init, noise = GaussianPolicy.n_outputs, GaussianPolicy.init, GaussianPolicy.noise
    gaussian, distribution = GaussianPolicy.gaussian, GaussianPolicy.distribution


@pytest.mark.parametrize("double", [False, True])
def test_the_first_and_the_last_number_of_a_uniform_draw_are_finite_noise(double):
    with jax.enable_x64(double):
        policy, step = policy_of("uniform"), float(jnp.finfo(jnp.zeros(()).dtype).eps)
        drawn = jnp.array([[0.0, 0.5], [1 - step, 1 - step]])
        noise, z = continued(policy, drawn, jnp.zeros((2, 2)), jnp.array([True, True]), 0.5)
        assert np.isfinite(z).all()
        assert (np.asarray(noise) < 1).all()


def test_a_policy_that_does_not_say_how_its_noise_is_distributed_is_refused_by_name(monkeypatch):
    monkeypatch.setitem(POLICIES, "silent", Silent)
    check_correlation(Silent(), None)
    with pytest.raises(UsageError, match=r"^noise_correlation is 0\.5, but Silent doesn't say how"):
        galton.A2C("bandit", "gaussian", policy="silent", noise_correlation=0.5)


@pytest.mark.parametrize("name", POLICIES)
def test_each_policy_of_ours_says_how_each_leaf_of_its_noise_is_distributed(name):
    policy = POLICIES[name](**{"n_bins": 7} if "n_bins" in settings(POLICIES[name]) else {}).on(BOX)
    assert isinstance(policy, Correlatable)
    noise = policy.noise(jax.random.key(1), (20_000,))
    marginals = policy.noise_marginals
    assert jax.tree.structure(marginals) == jax.tree.structure(noise)
    for marginal, leaf in zip(jax.tree.leaves(marginals), jax.tree.leaves(noise), strict=True):
        entries = np.asarray(leaf, np.float64).reshape(len(leaf), -1).T
        for numbers in entries:
            assert stats.kstest(numbers, {"normal": "norm", "uniform": "uniform"}[marginal]).pvalue > 1e-3
        if len(entries) > 1:
            assert abs(np.corrcoef(entries) - np.eye(len(entries))).max() < 4 / np.sqrt(20_000)
