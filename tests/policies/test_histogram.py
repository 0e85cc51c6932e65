import itertools

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.stats import chisquare, norm

from galton import Bins
from galton.parts import Box
from galton.policies import Histogram, HistogramPolicy
from galton.policies.histogram import NOWHERE, Choices, sample_bin

SAMPLE = jax.jit(jax.vmap(sample_bin, (None, 0)))
N = 5_000


def uniforms(seed=0):
    return np.random.default_rng(seed).uniform(size=N).astype(np.float32)


def policy_on(low, high, **settings):
    return HistogramPolicy(**settings).on(Box.of(np.atleast_1d(low), np.atleast_1d(high)))


def drawn(policy, logits, n, seed=0):
    """Actions `[n, d]` of a policy with these logits in every state, and which of them count as the edge."""

    @jax.jit
    def draw(logits, key):
        distribution = policy.distribution(jnp.broadcast_to(logits, (n, *logits.shape)), {})
        action = distribution.sample(policy.noise(key, (n,)))
        return action, distribution.at_edge(action)

    return [np.asarray(each) for each in draw(jnp.asarray(logits), jax.random.key(seed))]


@pytest.mark.parametrize("k", [2, 3, 10, 50, 100, 200, 211])
def test_sample_bin_inverts_the_cdf(k):
    logits = 2 * np.random.default_rng(k).normal(size=k).astype(np.float32)
    exact = np.exp(logits.astype(np.float64))
    cdf, u = np.cumsum(exact / exact.sum()), uniforms(k)
    expected, got = np.searchsorted(cdf, u, side="right"), np.asarray(SAMPLE(logits, u))
    at_an_edge = np.abs(cdf[None] - u[:, None]).min(1) < 1e-6
    assert at_an_edge.mean() < 0.01
    np.testing.assert_array_equal(got[~at_an_edge], expected[~at_an_edge])


@pytest.mark.parametrize("k", [2, 50, 100])
def test_sample_bin_never_leaves_the_bins_or_takes_an_impossible_one(k):
    u = uniforms()
    u[:2] = 0.0, np.nextafter(np.float32(1), np.float32(0))
    logits = np.where(np.arange(k) == k // 2, 0, -200).astype(np.float32)
    np.testing.assert_array_equal(SAMPLE(logits, u), k // 2)
    u[:] = 1 - 6e-8
    np.testing.assert_array_equal(SAMPLE(np.zeros(k, np.float32), u), k - 1)


def test_large_logits_are_sampled_as_small_ones():
    large, u = 512 + np.random.default_rng(0).normal(size=50).astype(np.float32), uniforms()
    np.testing.assert_array_equal(SAMPLE(large, u), SAMPLE(large - 512, u))


@pytest.mark.slow
def test_samples_follow_the_softmax():
    policy, n = policy_on([-1.0, 0.0], [1.0, 4.0], n_bins=20), 100_000
    logits = jax.random.normal(jax.random.key(0), (40,))
    index = np.asarray(policy.bins.encode(drawn(policy, logits, n, seed=1)[0]))
    for dimension in range(2):
        counts = np.bincount(index[:, dimension], minlength=20)
        expected = n * np.asarray(jax.nn.softmax(logits.reshape(2, 20)[dimension]), np.float64)
        assert chisquare(counts, expected * n / expected.sum()).pvalue > 1e-3


@pytest.mark.parametrize("bin_centers", ["inside", "bounds"])
def test_a_place_is_drawn_anywhere_in_its_bin_whichever_the_bin(bin_centers):
    policy = policy_on(0.0, 8.0, n_bins=5, bin_sample="uniform", bin_centers=bin_centers)
    action, at_edge = (each[:, 0] for each in drawn(policy, np.zeros(5, np.float32), 40_000))
    edges = policy.bins.edges[0]
    np.testing.assert_allclose(edges, np.linspace(0, 8, 6) if bin_centers == "inside" else [0, 1, 3, 5, 7, 8])
    for i, (low, high) in enumerate(itertools.pairwise(edges)):
        inside = (action > low) & (action < high)
        assert inside.mean() == pytest.approx(0.2, abs=0.01)
        assert chisquare(np.histogram(action[inside], 10, (low, high))[0]).pvalue > 1e-3
        assert (at_edge[inside] == (i in (0, 4))).all()


def test_deterministic_actions_are_mode_mean_and_median():
    bins, rules = Bins(0.0, 4.0, 4), ("mode", "mean", "median")
    actions = jax.jit(
        lambda logits: [
            Histogram(bins, logits, Choices(deterministic_action=rule)).deterministic_action() for rule in rules
        ]
    )(np.log(np.float32([[0.4, 0.05, 0.25, 0.3]])))
    mean = 0.4 * 0.5 + 0.05 * 1.5 + 0.25 * 2.5 + 0.3 * 3.5
    assert [float(action[0]) for action in actions] == [0.5, pytest.approx(mean), 2.5]


def test_a_mean_that_a_mask_forbids_is_the_nearest_center_that_it_allows():
    bins, masked = Bins([-1.0], [1.0], 5), Choices(deterministic_action="mean", is_masked=True)
    logits = np.log(
        np.array([[[0.5, 1e-9, 1e-9, 1e-9, 0.5]], [[0.6, 0.2, 0.1, 0.05, 0.05]], [[0.3, 0.1, 0.1, 0.1, 0.4]]])
    )
    allowed = np.array([[[1, 0, 0, 0, 1]], [[1, 1, 1, 1, 1]], [[1, 0, 0, 1, 1]]])
    found = Histogram(bins, jnp.where(allowed > 0, logits, NOWHERE), masked).deterministic_action()
    np.testing.assert_allclose(found[:, 0], [-0.8, -0.5, 0.4], rtol=1e-6)


def test_gaussian_exploration_has_the_policys_moments_and_leaves_the_box():
    policy, n = policy_on(3.0, 5.0, n_bins=40, exploration="gaussian"), 200_000
    logits = np.random.default_rng(2).normal(size=40).astype(np.float32)
    exact = np.exp(logits.astype(np.float64))
    probs, centers = exact / exact.sum(), policy.bins.centers[0]
    action = drawn(policy, logits, n, seed=3)[0].astype(np.float64)
    mean = (probs * centers).sum()
    std = np.sqrt((probs * (centers - mean) ** 2).sum())
    assert action.mean() == pytest.approx(mean, abs=5 * std / np.sqrt(n))
    assert action.std() == pytest.approx(std, rel=0.01)
    assert action.max() > 5


def test_the_log_density_of_gaussian_exploration_is_that_gaussians_and_finite():
    bins, action = Bins([-1.0, 0.0], [1.0, 4.0], 40), np.float32([1.3, 2.2])
    logits = np.zeros((3, 2, 40), np.float32)
    logits[0], logits[1, :, 3] = np.random.default_rng(4).normal(size=(2, 40)), 500

    @jax.jit
    def tell(logits):
        distribution = Histogram(bins, logits, Choices(exploration="gaussian"))
        at_mean = distribution.log_prob(distribution.mean())
        at_action = distribution.log_prob(jnp.broadcast_to(action, (3, 2)))
        return at_action, at_mean, distribution.std(), distribution.entropy()

    found, at_mean, std, entropy = tell(logits)
    exact = np.exp(logits[0].astype(np.float64))
    probs = exact / exact.sum(-1, keepdims=True)
    mean = (probs * bins.centers).sum(-1)
    expected = np.sqrt((probs * (bins.centers - mean[:, None]) ** 2).sum(-1))
    np.testing.assert_allclose(std[0], expected, rtol=1e-5)
    assert float(found[0]) == pytest.approx(norm.logpdf(action, mean, expected).sum(), rel=1e-5)
    assert (std[1] == 0).all()
    assert np.isfinite(at_mean).all()
    np.testing.assert_allclose(entropy[1:], [0, 2 * np.log(40)], rtol=1e-6, atol=1e-6)  # the sum over dimensions


def test_the_log_density_of_a_certain_policys_gaussian_exploration_has_no_slope():
    bins, logits = Bins(-1.0, 1.0, 5), jnp.array([[0.0, 0.0, 120.0, 0.0, 0.0]])
    slope = jax.grad(lambda x: Histogram(bins, x, Choices(exploration="gaussian")).log_prob(jnp.array([0.1])))(logits)
    np.testing.assert_array_equal(slope, np.zeros((1, 5)))


START = jax.jit(lambda policy: jax.nn.softmax(policy.by_dimension(policy.init()[0])))


def test_init_gaussian_starts_like_the_gaussian_policy_of_the_same_numbers():
    policy = policy_on(0.0, 8.0, n_bins=400, initial_policy="gaussian")
    edges = np.linspace(0, 8, 401)
    for numbers, mean, std in (({}, 0, 1), ({"log_std_init": -1.0, "box_units": 1.0}, 4, 4 / np.e)):
        expected = np.diff(norm.cdf(edges, mean, std))
        found = START(policy.replace(**numbers))[0]
        np.testing.assert_allclose(found, expected / expected.sum(), atol=2e-6)
    floored = policy.replace(log_std_init=-9.0, log_std_min=-1.0, box_units=1.0)
    np.testing.assert_array_equal(START(floored)[0], found)


BOXES = np.array([(-1.0, 1.0), (-3.0, 1.0), (2.0, 2.5), (-400.0, 1.0)]).T


@pytest.mark.parametrize("centers", ["inside", "bounds"])
def test_it_starts_as_the_gaussians_clipped_actions_do(centers):
    low, high = BOXES
    policy = policy_on(low, high, n_bins=30, initial_policy="clipped-gaussian", bin_centers=centers)
    edges = policy.bins.edges.astype(np.float64)
    edges[:, 0], edges[:, -1] = -np.inf, np.inf
    for log_std in (0.0, -1.0, 2.0):
        for box_units in (0.0, 1.0):
            mean, std = np.zeros(4), np.exp(log_std) * np.ones(4)
            if box_units:
                mean, std = (low + high) / 2, std * (high - low) / 2
            z = (edges - mean[:, None]) / std[:, None]
            expected = np.where(z[:, :-1] > 0, -np.diff(norm.sf(z)), np.diff(norm.cdf(z)))
            found = START(policy.replace(log_std_init=log_std, box_units=box_units))
            np.testing.assert_allclose(found, expected, rtol=2e-3, atol=2e-6)


@pytest.mark.parametrize("start", ["gaussian", "clipped-gaussian"])
def test_a_start_of_any_width_is_finite(start):
    policy = policy_on(*BOXES, n_bins=30, initial_policy=start)
    for log_std in (-12.0, 8.0):
        for box_units in (0.0, 1.0):
            assert np.isfinite(START(policy.replace(log_std_init=log_std, box_units=box_units))).all()
