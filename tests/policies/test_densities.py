"""Clipped, truncated and squashed Gaussians and Beta, in float32, against torch and scipy in float64."""

import functools

import jax
import jax.numpy as jnp
import numpy as np
import pytest
import torch
from scipy import stats

from galton.policies import Beta

from .densities import NAMES, Reference, make, outputs_of, reference

LOW = np.array([-1.0, -3.0, 2.0, -1e-3, 0.0, -400.0], np.float32)
HIGH = np.array([1.0, 1.0, 2.5, 1e-3, 1e4, 1.0], np.float32)
"""One of each kind: symmetric and not, without 0, tiny, huge, and with 0 near its end."""
MEAN = np.array([0.0, 0.4, -0.8, 0.1, 1.5, -2.0, 4.0])
LOG_STD = np.array([0.0, -0.7, -2.0, 1.0, -1.0, 0.5, -2.0])
"""In units of the box: means inside it, and three beyond it."""
N = 16
"""Actions of each."""


@functools.cache
def sampled(name):
    """Outputs `[7, N, …]`, log σ `[7, 6]`, actions `[7, N, 6]`, and log π."""
    outputs = outputs_of(name, np.tile(MEAN[:, None, None], (N, len(LOW))))

    def tell(outputs, log_std, key):
        policy, distribution = make(name, LOW, HIGH, outputs, log_std)
        action = distribution.sample(policy.noise(key, (N,)))
        if name in ("squashed-gaussian", "beta"):  # near a bound float32 can't say where an action is
            room = jnp.minimum(action - LOW, HIGH - action) / (HIGH - LOW)
            action = jnp.where(room > 3e-3, action, LOW + 0.3 * (HIGH - LOW))
        return action, distribution.log_prob(action)

    keys, log_std = jax.random.split(jax.random.key(0), len(MEAN)), np.tile(LOG_STD[:, None], len(LOW))
    return outputs, log_std, *jax.jit(jax.vmap(tell))(outputs, jnp.asarray(log_std, jnp.float32), keys)


@pytest.mark.parametrize("name", NAMES)
def test_log_prob_and_its_gradient_are_torchs_in_every_box(name, trust):
    outputs, log_std, action, log_prob = sampled(name)
    given = [np.float32(outputs).astype(np.float64), np.float32(log_std).astype(np.float64)[:, None]]
    tensors = [torch.tensor(x, requires_grad=True) for x in given]
    expected = Reference(name, LOW, HIGH, *tensors).log_prob(action).sum(-1)
    np.testing.assert_allclose(log_prob, expected.detach().numpy(), rtol=1e-5, atol=1e-5)
    with jax.enable_x64(True):
        action = jnp.asarray(action, float)
        log_probs = lambda *given: make(name, LOW, HIGH, *given[:2])[1].log_prob(given[2])  # noqa: E731
        slopes = jax.vmap(jax.grad(lambda *given: log_probs(*given).sum(), (0, 1)))
        ours = jax.jit(slopes)(given[0], given[1][:, 0], action)
    theirs = torch.autograd.grad(expected.sum(), tensors, allow_unused=True)
    for our, their in zip(ours, theirs, strict=True):
        expected_slope = np.zeros(our.shape) if their is None else their.numpy().reshape(our.shape)  # Beta has no σ
        np.testing.assert_allclose(our, expected_slope, rtol=1e-5, atol=1e-5)
    promise = "Densities over a box have torch's log-probability, in six boxes, and its gradient to 1e-5 of it."
    known, unit = expected.detach().numpy(), "of log π, or of 1 where that is larger"
    error = np.max(np.abs(log_prob - known) / np.maximum(1, np.abs(known)))
    trust("densities", promise, topic="numbers", figure=float(error), unit=unit, at_most=1e-5)


@functools.cache
def many(name):
    """20,000 actions for each mean and σ, all in the box [−3, 1]."""
    d, n = len(MEAN), 20_000
    low, high = np.full(d, -3.0), np.full(d, 1.0)

    def draw(key):
        policy, distribution = make(name, low, high, jnp.tile(outputs_of(name, MEAN), (n, 1)), LOG_STD)
        return distribution.sample(policy.noise(key, (n,)))

    return np.asarray(jax.jit(draw)(jax.random.key(1)), np.float64)


@pytest.mark.few
@pytest.mark.parametrize("i", range(len(MEAN)))
def test_samples_follow_the_distribution(i):
    for name in NAMES:
        action, mean, std = many(name)[:, i], 2 * MEAN[i] - 1, 2 * np.exp(LOG_STD[i])
        assert ((action >= -3) & (action <= 1)).all()
        if name == "beta":
            shapes = 1 + np.logaddexp(0, np.float64(outputs_of("beta", MEAN[i : i + 1])))
            known = stats.beta(*shapes, -3, 4)
        elif name == "squashed-gaussian":
            x = (action + 1) / 2
            known, action = stats.norm(MEAN[i], np.exp(LOG_STD[i])), np.arctanh(x[abs(x) < 1 - 1e-6])
            assert len(action) > 19_900 or i == 3
        elif name == "clipped-gaussian":
            known, inside = stats.norm(mean, std), (action > -3) & (action < 1)
            tails = known.cdf(-3), known.sf(1)
            found = np.mean(action == -3), np.mean(action == 1)
            np.testing.assert_allclose(found, tails, atol=4 * np.sqrt(0.25 / len(action)))
            action = action[inside]
            known = stats.truncnorm((-3 - mean) / std, (1 - mean) / std, mean, std)
        else:
            known = stats.truncnorm((-3 - mean) / std, (1 - mean) / std, mean, std)
        if mean > 1 and name == "truncated-gaussian":  # scipy's other tail has the digits
            known, action = stats.truncnorm((mean - 1) / std, (mean + 3) / std, -mean, std), -action
        if len(action) > 100:
            assert stats.kstest(action, known.cdf).pvalue > 1e-3, name


def fine_grid(low, high):
    """Nodes and weights of a fine rule on an interval, by Gauss and Legendre in 400 panels."""
    nodes, weights = np.polynomial.legendre.leggauss(20)
    edges = np.linspace(low, high, 401)
    half = np.diff(edges)[:, None] / 2
    return ((edges[:-1, None] + half) + half * nodes).ravel(), (half * weights).ravel()


def moments(name, low, high, mean, log_std):
    """Entropy and standard deviation by quadrature in float64."""
    known = reference(name, low, high, outputs_of(name, [mean]), log_std)
    half = (high - low) / 2
    if name == "squashed-gaussian":
        u, weight = fine_grid(mean - 10 * np.exp(log_std), mean + 10 * np.exp(log_std))
        weight = weight * stats.norm.pdf(u, mean, np.exp(log_std))
        slope = 2 * (np.log(2) - abs(u) - np.log1p(np.exp(-2 * abs(u))))
        log_prob = stats.norm.logpdf(u, mean, np.exp(log_std)) - slope - np.log(half)
        action = (low + high) / 2 + half * np.tanh(u)
    else:
        action, weight = fine_grid(low, high)
        log_prob = known.log_prob(action).numpy()
        weight = weight * np.exp(log_prob)
    if name == "clipped-gaussian":
        bounds = np.array([low, high])
        tails = known.log_prob(bounds).numpy()
        action, log_prob = np.append(action, bounds), np.append(log_prob, tails)
        weight = np.append(weight, half * np.exp(tails))
    assert weight.sum() == pytest.approx(1, abs=1e-6)
    mean = weight @ action
    return -weight @ log_prob, np.sqrt(weight @ (action - mean) ** 2)


@pytest.mark.parametrize("name", NAMES)
@pytest.mark.parametrize(("low", "high"), [(-3.0, 1.0), pytest.param(0.0, 64.0, marks=pytest.mark.slow)])
def test_entropy_and_std_are_those_of_the_distribution(name, low, high):
    outputs = outputs_of(name, MEAN[:, None])

    def tell(outputs, log_std):
        distribution = make(name, low, high, outputs, log_std)[1]
        return distribution.entropy(), distribution.std()[0]

    found = jax.jit(jax.vmap(tell))(outputs, jnp.asarray(LOG_STD, jnp.float32))
    expected = np.array([moments(name, low, high, *one) for one in zip(MEAN, LOG_STD, strict=True)])
    wide = np.exp(LOG_STD) > 2 if name == "squashed-gaussian" else np.zeros(len(MEAN), bool)  # as it documents
    np.testing.assert_allclose(found[0][~wide], expected[~wide, 0], rtol=1e-5, atol=1e-5)
    np.testing.assert_allclose(found[0][wide], expected[wide, 0], rtol=2e-5, atol=5e-5)
    np.testing.assert_allclose(found[1], expected[:, 1], rtol=1e-3, atol=1e-6)


@pytest.mark.few
@pytest.mark.parametrize("name", [name for name in NAMES if "gaussian" in name])
def test_entropys_gradient_is_that_of_the_distribution(name):
    """Against differences of fourth order of a quadrature in float64, where the squashed Gaussian's rule holds."""
    some = np.exp(LOG_STD) <= 2

    def entropy(mean, log_std):
        return make(name, -3.0, 1.0, mean[None], log_std)[1].entropy()

    mean, log_std = (jnp.asarray(given[some], jnp.float32) for given in (MEAN, LOG_STD))
    found = jax.jit(jax.vmap(jax.grad(entropy, (0, 1))))(mean, log_std)
    for i, step in enumerate(np.eye(2) * 1e-2):
        expected = [
            sum(
                weight * moments(name, -3.0, 1.0, *(np.array(one) + k * step))[0]
                for k, weight in ((-2, 1 / 12), (-1, -2 / 3), (1, 2 / 3), (2, -1 / 12))
            )
            / 1e-2
            for one in zip(MEAN[some], LOG_STD[some], strict=True)
        ]
        np.testing.assert_allclose(found[i], expected, rtol=1e-4, atol=2e-5)


@pytest.mark.slow
@pytest.mark.parametrize("name", NAMES)
def test_all_is_finite_at_the_bounds_beyond_them_and_for_extreme_parameters(name):
    size = HIGH - LOW
    ends = [LOW, HIGH, np.nextafter(LOW, HIGH), np.nextafter(HIGH, LOW), LOW - 50 * size, HIGH + 50 * size]
    action = jnp.asarray(np.stack([*ends, LOW + size / 3]))
    mean, log_std = (x.ravel() for x in np.meshgrid([-1e3, -50.0, -1.0, 0.0, 1.0, 50.0, 1e3], [-12.0, -4.0, 0.0, 5.0]))
    outputs = outputs_of(name, np.tile(mean[:, None], len(LOW)))

    def tell(outputs, log_std, action):
        distribution = make(name, LOW, HIGH, outputs, log_std)[1]
        return distribution.log_prob(action), distribution.entropy(), distribution.std(), distribution.sample(noise)

    noise = jax.tree.map(jnp.asarray, make(name, LOW, HIGH, outputs[0])[0].noise(jax.random.key(2), ()))
    one = lambda *given: (tell(*given), jax.jacrev(lambda *x: tell(*x)[:2], (0, 1))(*given))  # noqa: E731
    each = jax.jit(jax.vmap(jax.vmap(one, (0, 0, None)), (None, None, 0)))
    for leaf in jax.tree.leaves(each(outputs, jnp.asarray(log_std, jnp.float32), action)):
        assert np.isfinite(leaf).all()


DETERMINISTIC = {
    "clipped-gaussian": ([0.3, -4.0], [0.3, -1.0]),
    "truncated-gaussian": ([0.3, 4.0], [0.3, 1.0]),
    "squashed-gaussian": ([0.3, 40.0], [np.tanh(0.3), 1.0]),
    "beta": ([0.0, 0.0, 1.0, -1.0], [0.0, 2 * 2.3132617 / (2.3132617 + 1.3132617) - 1]),
}


@pytest.mark.parametrize("name", NAMES)
def test_the_deterministic_action_and_the_edge_are_what_docstrings_say(name):
    outputs, expected = DETERMINISTIC[name]
    distribution = make(name, -np.ones(2), np.ones(2), np.array([outputs]))[1]
    np.testing.assert_allclose(distribution.deterministic_action(), [expected], rtol=1e-5, atol=1e-7)
    assert distribution.at_edge(jnp.array([1.0, -1.5])).all()
    assert not distribution.at_edge(jnp.array([0.97, -0.97])).any()
    assert bool(distribution.at_edge(jnp.array([-0.985, 0.0]))[0]) == (name != "clipped-gaussian")


@pytest.mark.slow
def test_they_start_where_the_gaussians_numbers_say():
    for name in NAMES[:3]:
        policy, _ = make(name, -3.0, 1.0, [0.0])
        bias, params = policy.replace(log_std_init=-1.5).init()
        assert (np.asarray(bias) == 0).all()
        np.testing.assert_allclose(params["log_std"], -1.5)
        floored, there = (make(name, -3.0, 1.0, [0.2], s, log_std_min=-2.0)[1] for s in (-9.0, -2.0))
        np.testing.assert_allclose(floored.entropy(), there.entropy(), rtol=1e-6)
    policy, _ = make("beta", -1.0, 1.0, [0.0, 0.0])
    outputs, params = policy.init()
    start = policy.distribution(jnp.asarray(outputs), params)
    np.testing.assert_allclose([start.alpha, start.beta], 1 + np.log(2), rtol=1e-6)
    assert float(start.std()[0]) == pytest.approx(0.478, abs=1e-3)


def test_beta_is_right_for_small_and_large_shapes():
    a, b = (x.ravel() for x in np.meshgrid([1.0, 1.3, 3.0, 50.0, 1e4], [1.0, 2.0, 700.0]))
    known, ones = stats.beta(a, b), np.ones(1, np.float32)
    action = np.clip(known.ppf([[0.01], [0.3], [0.6], [0.99]]), 1e-5, 1 - 1e-5).astype(np.float32)

    def tell(a, b, action):
        distribution = Beta(a[None], b[None], 0 * ones, ones)
        return jax.vmap(lambda x: distribution.log_prob(x[None]))(action), distribution.entropy(), distribution.std()

    given = (jnp.asarray(x, jnp.float32) for x in (a, b, action.T))
    log_prob, entropy, std = jax.jit(jax.vmap(tell))(*given)
    np.testing.assert_allclose(log_prob.T, known.logpdf(action.astype(np.float64)), rtol=1e-4, atol=2e-3)
    np.testing.assert_allclose(entropy, known.entropy(), rtol=1e-5, atol=2e-5)
    np.testing.assert_allclose(std[:, 0], known.std(), rtol=1e-5)
