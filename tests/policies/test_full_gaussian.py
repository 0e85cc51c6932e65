"""The Gaussian with a full covariance matrix is scipy's, in float64, and starts as the Gaussian does."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy import stats

from galton.parts import Box
from galton.policies import FullGaussianPolicy, GaussianPolicy

pytestmark = pytest.mark.usefixtures("double")

RNG = np.random.default_rng(0)
BOX = Box((-1.0, 0.0, -2.0), (1.0, 3.0, 1.0))
HALF, CENTER = np.array([1.0, 1.5, 1.5]), np.array([0.0, 1.5, -0.5])


def params_of(seed):
    rng = np.random.default_rng(seed)
    return {"log_std": jnp.asarray(rng.normal(-0.5, 0.5, 3)), "lower": jnp.asarray(rng.normal(0, 0.7, 3))}


def covariance(params, unit):
    """L Lᵀ, with L written out."""
    (a, b, c), (p, q, r) = np.exp(np.asarray(params["log_std"])), np.asarray(params["lower"])
    factor = np.array([[a, 0, 0], [p, b, 0], [q, r, c]])
    return np.diag(unit) @ factor @ factor.T @ np.diag(unit)


@pytest.mark.parametrize("box_units", [0.0, 1.0])
def test_log_prob_entropy_std_and_samples_are_scipys(box_units):
    policy, params = FullGaussianPolicy(box_units=box_units).on(BOX), params_of(1)
    outputs, unit = RNG.normal(size=(4, 3)), HALF if box_units else np.ones(3)
    means, found = CENTER + HALF * outputs if box_units else outputs, policy.distribution(jnp.asarray(outputs), params)
    of = covariance(params, unit)
    action = RNG.normal(size=(4, 3))
    known = [stats.multivariate_normal(mean, of) for mean in means]
    np.testing.assert_allclose(
        found.log_prob(action), [one.logpdf(a) for one, a in zip(known, action, strict=True)], rtol=1e-11
    )
    np.testing.assert_allclose(found.entropy(), [one.entropy() for one in known], rtol=1e-11)
    np.testing.assert_allclose(found.std(), np.tile(np.sqrt(np.diag(of)), (4, 1)), rtol=1e-11)
    alone = policy.distribution(jnp.broadcast_to(outputs[0], (100_000, 3)), params)
    drawn = np.asarray(alone.sample(policy.noise(jax.random.key(0), (100_000,))))
    np.testing.assert_allclose(np.cov(drawn.T), of, atol=0.02 * np.diag(of).max())
    np.testing.assert_allclose(drawn.mean(0), means[0], atol=0.02)
    np.testing.assert_array_equal(found.deterministic_action(), np.clip(means, BOX.low, BOX.high))


def test_the_divergence_is_that_of_matrices_and_its_slope_the_mean_scores():
    """KL = ½ (tr Σ'⁻¹Σ + δᵀ Σ'⁻¹ δ − d + log det Σ' / det Σ); at equal distributions it and its gradient are 0."""
    policy, outputs = FullGaussianPolicy(box_units=1.0).on(BOX), RNG.normal(size=(2, 5, 3))
    one, other = (policy.distribution(jnp.asarray(x), params_of(i)) for i, x in enumerate(outputs))
    of, its = (covariance(params_of(i), HALF) for i in (0, 1))
    delta, inverse = HALF * (outputs[0] - outputs[1]), np.linalg.inv(its)
    squares = np.einsum("bi,ij,bj->b", delta, inverse, delta)
    expected = 0.5 * (np.trace(inverse @ of) + squares - 3 + np.log(np.linalg.det(its) / np.linalg.det(of)))
    np.testing.assert_allclose(one.kl(other), expected, rtol=1e-10)

    def divergence(params):
        return one.kl(policy.distribution(jnp.asarray(outputs[0]), params)).sum()

    at_itself, slope = jax.value_and_grad(divergence)(params_of(0))
    assert float(at_itself) == pytest.approx(0, abs=1e-12)
    for leaf in jax.tree.leaves(slope):
        np.testing.assert_allclose(leaf, 0, atol=1e-12)


@pytest.mark.parametrize("box_units", [0.0, 1.0])
def test_it_starts_as_the_gaussian(box_units):
    settings = {"box_units": box_units, "log_std_init": -0.3, "log_std_min": -0.2}
    full, plain = (kind(**settings).on(BOX) for kind in (FullGaussianPolicy, GaussianPolicy))
    outputs, action = jnp.asarray(RNG.normal(size=(4, 3))), jnp.asarray(RNG.normal(size=(4, 3)))
    ours, theirs = (policy.distribution(outputs, policy.init()[1]) for policy in (full, plain))
    for name in ("log_prob", "sample", "at_edge"):
        np.testing.assert_allclose(getattr(ours, name)(action), getattr(theirs, name)(action), rtol=1e-12)
    for name in ("entropy", "std", "deterministic_action"):
        np.testing.assert_allclose(getattr(ours, name)(), getattr(theirs, name)(), rtol=1e-12)
