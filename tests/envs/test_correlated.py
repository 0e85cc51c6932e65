"""Bandits with correlated dimensions: their optima beside enumerations and coordinate ascent in numpy."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.special import logsumexp, softmax

from galton import UsageError
from galton.envs import RidgeBandit, XorBandit, make

K = 40


def grid(env, k, d=2):
    """The expected reward of each cell's center, with an axis for each dimension, and the width of a bin."""
    axis = -1 + 2 * (np.arange(k) + 0.5) / k
    cells = np.stack(np.meshgrid(*[axis] * d, indexing="ij"), -1)
    return np.asarray(env.worth(jnp.asarray(cells)), np.float64), 2 / k


def entropy(p):
    return -(p * np.log(np.maximum(p, 1e-300))).sum()


def ascended(worth, alpha, rng):
    """The value that coordinate ascent over factored policies on a grid comes to, the best of a few starts."""
    values = []
    for _ in range(10):
        p, q = rng.dirichlet(np.full(len(worth), 0.1), 2)
        for _ in range(500):
            p = softmax(worth @ q / alpha)
            q = softmax(p @ worth / alpha)
        values.append(p @ worth @ q + alpha * (entropy(p) + entropy(q)))
    return max(values)


@pytest.mark.parametrize("alpha", [0.1, 0.3, 0.45, 0.7])
def test_the_optima_of_xor_are_those_of_an_enumeration(alpha):
    env = XorBandit()
    worth, _ = grid(env, 8)
    assert env.soft_optimum(alpha, 8) == pytest.approx(alpha * logsumexp(worth / alpha), rel=1e-6)
    best = softmax(worth / alpha)
    assert env.soft_optimum(alpha, 8) == pytest.approx((best * worth).sum() + alpha * entropy(best), rel=1e-6)
    assert env.factored_optimum(alpha, 8) == pytest.approx(ascended(worth, alpha, np.random.default_rng(0)), rel=1e-6)
    assert env.factored_optimum(alpha, 8) < env.soft_optimum(alpha, 8) - 0.01


@pytest.mark.parametrize(("alpha", "across"), [(0.05, 25.0), (0.03, 4.0)])
def test_the_optima_of_the_ridge_are_those_of_a_fine_grid(alpha, across):
    """Of densities: the entropy over bins is the density's less the logarithm of a bin's area."""
    env = RidgeBandit(across=across)
    with jax.enable_x64(True):
        worth, width = grid(env, K * 2)
    area = 2 * np.log(width)
    assert env.soft_optimum(alpha) == pytest.approx(alpha * (logsumexp(worth / alpha) + area), abs=1e-4)
    best = ascended(worth, alpha, np.random.default_rng(0)) + alpha * area
    assert env.factored_optimum(alpha) == pytest.approx(best, abs=1e-4)


def test_the_ridges_optima_are_gaussians_values_in_any_dimension():
    """E r + α h of N(c, Σ) is −½ tr QΣ + α/2 log det 2πe Σ."""
    env, alpha = RidgeBandit(d=4), 0.05
    Q = env.curvature
    assert np.linalg.eigvalsh(Q) == pytest.approx([1, 25, 25, 25])
    for found, covariance in (
        (env.soft_optimum(alpha), alpha * np.linalg.inv(Q)),
        (env.factored_optimum(alpha), alpha * np.diag(1 / np.diag(Q))),
    ):
        log_det = np.linalg.slogdet(2 * np.pi * np.e * covariance)[1]
        assert found == pytest.approx(-0.5 * np.trace(Q @ covariance) + alpha / 2 * log_det)
    gap = alpha / 2 * np.log(np.prod(np.diag(Q)) / np.linalg.det(Q))
    assert env.soft_optimum(alpha) - env.factored_optimum(alpha) == pytest.approx(gap)


def test_rewards_are_the_actions_worth_and_the_noise():
    rng = np.random.default_rng(0)
    for env, worth in (
        (XorBandit(), lambda a: float(np.sign(a[0]) != np.sign(a[1]))),
        (RidgeBandit(), lambda a: -0.5 * (a - 0.2) @ (np.array([[13.0, -12.0], [-12.0, 13.0]]) @ (a - 0.2))),
    ):
        actions = rng.uniform(-1, 1, (100_000, 2))
        state = env.reset(jax.random.key(0))
        for action in actions[:5]:
            _, reward, ended = env.step(state, jnp.float32(action), 0.25)
            assert float(reward) == pytest.approx(worth(action) + 0.25, abs=1e-5)
            assert bool(ended)
        sampled = np.asarray(env.worth(jnp.float32(actions)), np.float64)
        assert abs(sampled.mean() - env.random_return) < 4 * sampled.std() / len(sampled) ** 0.5


@pytest.mark.parametrize(
    ("name", "constants", "told"),
    [
        ("xor-bandit", {"noise_std": -1.0}, "noise_std is -1.0; it must be 0 or more"),
        ("ridge-bandit", {"along": 0.0}, "along is 0.0; it must be greater than 0"),
        ("ridge-bandit", {"across": float("inf")}, "across is inf; it must be greater than 0"),
        ("ridge-bandit", {"center": 1.5}, "center is 1.5; it must lie in"),
        ("ridge-bandit", {"d": 0}, "d is 0; it must be an integer of at least 1"),
    ],
)
def test_constants_out_of_range(name, constants, told):
    with pytest.raises(UsageError, match=told):
        make(name, **constants)
