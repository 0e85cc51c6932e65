"""Pieces and tails of the normal distribution in float32, against scipy in float64."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy import integrate, stats

from galton.parts import Box
from galton.policies.tails import FAR, inside, log_tail, piece, quantile
from galton.policies.truncated_gaussian import TruncatedGaussianPolicy

GRID = [x.ravel() for x in np.meshgrid([0.0, 0.1, 1.0, 5.0, 30.0, 300.0, 5000.0], [1e-4, 0.01, 0.5, 2.0, 8.0, 100.0])]
"""Every ζ with every width."""
SHARES = np.array([1e-6, 1e-3, 0.1, 0.5, 0.9, 0.999, 1 - 1e-6], np.float32)


def exactly(zeta, width, n=0):
    reach = min(width, 80 / (zeta + np.sqrt(zeta**2 + 80)))
    return integrate.quad(lambda t: t**n * np.exp(-zeta * t - t * t / 2), 0, reach, epsabs=0, epsrel=1e-12)[0]


def test_a_piece_and_its_moments_are_the_integrals():
    for n, found in enumerate(jax.jit(piece)(*map(jnp.float32, GRID))):
        expected = [exactly(*one, n) for one in zip(*GRID, strict=True)]
        np.testing.assert_allclose(found, expected, rtol=2e-6)


def test_the_quantile_inverts_the_pieces_mass():
    each = jax.jit(jax.vmap(jax.vmap(quantile, (None, None, 0)), (0, 0, None)))
    for zeta, width, reached in zip(*GRID, each(*map(jnp.float32, GRID), jnp.asarray(SHARES)), strict=True):
        found = np.array([exactly(zeta, float(t)) for t in reached]) / exactly(zeta, width)
        np.testing.assert_allclose(found, SHARES, atol=1e-6)
        assert found[0] == pytest.approx(1e-6, rel=1e-4)  # near the edge it is right to many digits


def test_log_tail_and_its_gradient_are_right_however_large_the_argument():
    x = np.concatenate([-np.logspace(2, -3, 30), [0], np.logspace(-6, 1.5, 40), [300, 1e4, 1e6]]).astype(np.float32)
    expected = stats.norm.logsf(x.astype(np.float64))
    found, slope = jax.jit(jax.vmap(jax.value_and_grad(log_tail)))(jnp.asarray(x))
    np.testing.assert_allclose(found, expected, rtol=1e-6, atol=1e-7)
    hazard = np.where(x < 30, np.exp(stats.norm.logpdf(x.astype(np.float64)) - expected), x)
    np.testing.assert_allclose(slope, -hazard, rtol=2e-3, atol=1e-9)
    near = x < 30
    np.testing.assert_allclose(slope[near], -hazard[near], rtol=2e-6, atol=1e-9)


def test_log_tail_is_finite_as_far_as_numbers_go():
    x = jnp.float32([-np.inf, -1e30, 1e15, 1e30, np.inf])
    value, slope = jax.jit(jax.vmap(jax.value_and_grad(log_tail)))(x)
    assert np.isfinite(slope).all()
    np.testing.assert_allclose(value, np.where(x < 0, 0, -(FAR**2) / 2), rtol=1e-5)


MEASURE = jax.jit(inside)


@pytest.mark.parametrize(("mean", "std"), [(0.3, 0.5), (-2.0, 0.1), (7.0, 1.0), (0.0, 1e4), (1.0, 1e-4)])
def test_the_mass_inside_an_interval_is_scipys(mean, std):
    low, high = -1.0, 1.25
    part = MEASURE(*(jnp.float32(x) for x in (mean, std, low, high)))
    edge = np.clip(mean, low, high)
    sign = -1 if mean > high else 1  # scipy's distribution function is exact below the mean
    ends = sorted(sign * (np.array([low, high]) - mean) / std)
    upper = stats.norm.logsf(ends[0]), stats.norm.logsf(ends[1])
    expected = upper[0] + np.log1p(-np.exp(upper[1] - upper[0]))
    assert float(part.edge) == pytest.approx(edge)
    found = float(part.log_mass - 0.5 * part.zeta**2) - 0.5 * np.log(2 * np.pi)
    assert found == pytest.approx(expected, rel=1e-5, abs=1e-7)


def test_what_a_box_of_many_sigmas_leaves_of_the_tails_can_be_drawn():
    policy = TruncatedGaussianPolicy(box=Box.of(np.float32([-10]), np.float32([10])))
    mean, u = (x.reshape(-1, 1) for x in np.meshgrid([-5.0, 0.0, 4.9], [0.0, 1e-8, 2.0**-24, 1 - 2.0**-24]))

    @jax.jit
    def draw(mean, u):
        distribution = policy.distribution(mean, {"log_std": jnp.array([-0.03])})
        action = distribution.sample(u)
        return action, distribution.log_prob(action)

    action, log_prob = draw(np.float32(mean), np.float32(u))
    assert ((abs(action - mean) > 4) & (abs(action - mean) < 6.5)).all()
    assert np.isfinite(log_prob).all()


def test_a_mean_on_a_bound_has_the_slope_of_means_beside_it():
    """Of the truncated Gaussian it is (a − μ) / σ² + (φ(h) − φ(l)) / (σ Z), with h and l the bounds in σ."""
    policy = TruncatedGaussianPolicy(box_units=0).on(Box.of([0.0], [1.0]))
    sigma = np.exp(-1.0)
    params = {"log_std": jnp.full(1, -1.0)}
    slope = jax.grad(lambda mean: policy.distribution(mean, params).log_prob(jnp.array([0.5])))
    for mean in (0.0, 1.0):
        low, high = -mean / sigma, (1 - mean) / sigma
        mass = stats.norm.cdf(high) - stats.norm.cdf(low)
        expected = (0.5 - mean) / sigma**2 + (stats.norm.pdf(high) - stats.norm.pdf(low)) / (sigma * mass)
        np.testing.assert_allclose(slope(jnp.full(1, mean)), [expected], rtol=1e-5)
