"""The spline's density against scipy's B-splines and quadrature in float64, and its samples against its own CDF."""

import itertools

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy import integrate, interpolate, stats

from galton import UsageError

from ..agents import agent

LOW, HIGH, M = np.array([-1.0, 2.0], np.float32), np.array([1.0, 6.0], np.float32), 9
NODES = np.linspace(0, 1, 65)
RNG = np.random.default_rng(0)
COEFFICIENTS = 2 * RNG.normal(size=(5, 2, M)).astype(np.float32)


def policy_of(low=LOW, high=HIGH, **words):
    return agent({"loss": "gaussian", "policy": "spline", "n_splines": M, **words}, low=low, high=high).policy


def outputs_of(coefficients=COEFFICIENTS):
    return jnp.asarray(coefficients.reshape(len(coefficients), -1))


def spline_of(coefficients):
    """Scipy's, on clamped uniform knots of [0, 1]."""
    knots = np.concatenate([np.zeros(3), np.linspace(0, 1, len(coefficients) - 2), np.ones(3)])
    return interpolate.BSpline(knots, coefficients.astype(np.float64), 3)


class Known:
    """One dimension: exp of scipy's spline at the nodes, linear between them, and scipy's quadrature of that."""

    def __init__(self, coefficients, low, high):
        self.low, self.size = float(low), float(high) - float(low)
        self.weight = np.exp(spline_of(coefficients)(NODES))
        self.z = self.integral(lambda x: np.interp(x, NODES, self.weight))

    def integral(self, function):
        pieces = (integrate.quad(function, *cell, epsabs=1e-12)[0] for cell in itertools.pairwise(NODES))
        return self.size * sum(pieces)

    def pdf(self, x):
        return np.interp(x, NODES, self.weight) / self.z

    def mean(self, function):
        return self.integral(lambda x: self.pdf(x) * function(self.low + self.size * x))


KNOWN = [[Known(c, *ends) for c, *ends in zip(each, LOW, HIGH, strict=True)] for each in COEFFICIENTS]


def test_log_prob_entropy_mean_and_std_are_scipys():
    found = policy_of().distribution(outputs_of(), {})
    share = RNG.random((5, 2)).astype(np.float32)
    expected = [[np.log(one.pdf(x)) for one, x in zip(*pair, strict=True)] for pair in zip(KNOWN, share, strict=True)]
    action = jnp.asarray(LOW + (HIGH - LOW) * share)
    np.testing.assert_allclose(found.log_prob(action), np.sum(expected, -1), rtol=1e-5, atol=1e-5)
    entropies = [sum(one.integral(lambda x, p=one.pdf: -p(x) * np.log(p(x))) for one in each) for each in KNOWN]
    np.testing.assert_allclose(found.entropy(), entropies, rtol=1e-5, atol=1e-5)
    means = np.array([[one.mean(lambda a: a) for one in each] for each in KNOWN])
    squares = np.array([[one.mean(lambda a: a**2) for one in each] for each in KNOWN])
    np.testing.assert_allclose(found.mean(), means, rtol=1e-5, atol=1e-5)
    np.testing.assert_allclose(found.std(), np.sqrt(squares - means**2), rtol=1e-4)


def test_the_grid_is_near_the_spline_itself():
    found, at = policy_of().distribution(outputs_of(), {}), RNG.random((5, 2)).astype(np.float32)
    expected = np.zeros((5, 2))
    for i, j in np.ndindex(5, 2):
        spline = spline_of(COEFFICIENTS[i, j])
        z, _ = integrate.quad(lambda x, f=spline: np.exp(f(x)), 0, 1, limit=200)
        expected[i, j] = spline(at[i, j]) - np.log(z * (HIGH - LOW)[j])
    np.testing.assert_allclose(found.log_prob(jnp.asarray(LOW + (HIGH - LOW) * at)), expected.sum(-1), atol=5e-2)


def test_gradients_are_those_of_float64_by_differences():
    action = jnp.asarray(LOW + (HIGH - LOW) * RNG.random((5, 2)).astype(np.float32))

    def tell(outputs, action):
        found = policy_of().distribution(outputs, {})
        return found.log_prob(action).sum() + found.entropy().sum()

    ours = jax.jit(jax.grad(tell))(outputs_of(), action)
    with jax.enable_x64(True):
        given, whole = np.asarray(outputs_of(), float), jax.jit(tell)
        steps = np.eye(given.size).reshape(-1, *given.shape) * 1e-5
        differences = [
            (whole(given + h, np.float64(action)) - whole(given - h, np.float64(action))) / 2e-5 for h in steps
        ]
    np.testing.assert_allclose(np.ravel(ours), differences, rtol=1e-4, atol=1e-5)


def test_samples_follow_the_cdf():
    policy, n = policy_of(), 20_000
    outputs = jnp.tile(outputs_of(), (n, 1, 1))
    drawn = policy.distribution(outputs, {}).sample(policy.noise(jax.random.key(3), (n, 5)))
    assert (drawn >= LOW).all()
    assert (drawn <= HIGH).all()
    share = (np.asarray(drawn, np.float64) - LOW) / (HIGH - LOW)
    for i, j in np.ndindex(5, 2):
        weight = KNOWN[i][j].weight
        below = np.append(0, np.cumsum((weight[1:] + weight[:-1]) / 2))

        def cdf(x, weight=weight, below=below):
            cell = np.minimum((x * 64).astype(int), 63)
            s = x * 64 - cell
            return (below[cell] + s * weight[cell] + s**2 / 2 * (weight[cell + 1] - weight[cell])) / below[-1]

        assert stats.kstest(share[:, i, j], cdf).pvalue > 1e-3


@pytest.mark.parametrize("box_units", [0.0, 1.0])
def test_it_may_start_as_the_truncated_gaussian(box_units):
    low, high = np.float32([-1.0, -1.0]), np.float32([1.0, 3.0])
    policy = policy_of(low, high, initial_policy="gaussian", log_std_init=-0.9, box_units=box_units)
    bias, params = policy.init()
    found, center, half = policy.distribution(bias, params), (high + low) / 2, (high - low) / 2
    mean, std = (center, half * np.exp(-0.9)) if box_units else (np.zeros(2), np.exp([-0.9, -0.9]))
    known = stats.truncnorm((low - mean) / std, (high - mean) / std, mean, std)
    action = low + (high - low) * np.array([5, 30, 47])[:, None] / 64
    expected = known.logpdf(action).sum(-1)
    np.testing.assert_allclose([found.log_prob(jnp.asarray(a, jnp.float32)) for a in action], expected, atol=2e-3)
    np.testing.assert_allclose(found.std(), known.std(), rtol=2e-3)
    uniform = policy_of()
    first = uniform.distribution(*uniform.init())
    np.testing.assert_allclose(first.entropy(), np.log(HIGH - LOW).sum(), rtol=1e-6)


def test_without_exploration_it_takes_the_mode_or_the_mean():
    for rule, expected in (
        ("mode", [[LOW[j] + (HIGH - LOW)[j] * NODES[KNOWN[i][j].weight.argmax()] for j in (0, 1)] for i in range(5)]),
        ("mean", [[one.mean(lambda a: a) for one in each] for each in KNOWN]),
    ):
        for policy in (policy_of(deterministic_action=rule), policy_of().acting_by(rule)):
            found = policy.distribution(outputs_of(), {}).deterministic_action()
            np.testing.assert_allclose(found, expected, rtol=1e-5, atol=1e-5)
    with pytest.raises(UsageError, match="deterministic_action is 'median'; choose from mode, mean"):
        policy_of(deterministic_action="median")


def test_all_is_finite_for_large_coefficients_beyond_the_bounds_and_at_them():
    policy, signs = policy_of(), np.where(RNG.random((5, 2, M)) < 0.5, -300, 300)
    action = jnp.array([[-1.0, 2.0], [1.0, 6.0], [-9.0, 9.0], [0.0, 4.0], [0.99, 2.01]])

    def tell(outputs):
        found = policy.distribution(outputs, {})
        return found.log_prob(action).sum() + found.entropy().sum() + found.std().sum()

    for leaf in jax.value_and_grad(tell)(outputs_of(signs.astype(np.float32))):
        assert np.isfinite(leaf).all()
