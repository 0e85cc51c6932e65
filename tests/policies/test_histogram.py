import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.stats import chisquare, norm

from galton import Bins
from galton.parts import Box
from galton.policies import Histogram, HistogramPolicy
from galton.policies.histogram import Choices, sample_bin


@pytest.mark.parametrize("k", [2, 3, 10, 50, 100, 200, 211])
def test_sample_bin_inverts_the_cdf(k):
    logits = 2 * jax.random.normal(jax.random.key(k), (k,))
    cdf = np.cumsum(np.asarray(jax.nn.softmax(logits), np.float64))
    u = np.random.default_rng(k).uniform(size=5_000).astype(np.float32)
    expected = np.searchsorted(cdf, u, side="right")
    got = np.asarray(jax.vmap(lambda u: sample_bin(logits, u))(jnp.asarray(u)))
    at_an_edge = np.abs(cdf[None] - u[:, None]).min(1) < 1e-6
    assert at_an_edge.mean() < 0.01
    np.testing.assert_array_equal(got[~at_an_edge], expected[~at_an_edge])


@pytest.mark.parametrize("k", [2, 37, 100])
def test_sample_bin_never_leaves_the_bins_or_takes_an_impossible_one(k):
    logits = jnp.where(jnp.arange(k) == k // 2, 0.0, -200.0)
    for u in (0.0, 0.5, np.nextafter(np.float32(1), np.float32(0))):
        assert int(sample_bin(logits, jnp.float32(u))) == k // 2
    assert int(sample_bin(jnp.zeros(k), jnp.float32(1 - 6e-8))) == k - 1


@pytest.mark.slow
def test_samples_follow_the_softmax():
    policy = HistogramPolicy(n_bins=20).on(Box.of(np.array([-1.0, 0.0]), np.array([1.0, 4.0])))
    logits = jax.random.normal(jax.random.key(0), (40,))
    n = 100_000
    distribution = policy.distribution(jnp.broadcast_to(logits, (n, 40)), {})
    index = np.asarray(policy.bins.encode(distribution.sample(policy.noise(jax.random.key(1), (n,)))))
    for dimension in range(2):
        counts = np.bincount(index[:, dimension], minlength=20)
        expected = n * np.asarray(jax.nn.softmax(logits.reshape(2, 20)[dimension]), np.float64)
        assert chisquare(counts, expected * n / expected.sum()).pvalue > 1e-3


def test_uniform_in_bin_samples_fill_the_bin():
    policy = HistogramPolicy(n_bins=10, bin_sample="uniform").on(Box.of(np.array([0.0]), np.array([10.0])))
    logits = jnp.broadcast_to(jnp.where(jnp.arange(10) == 3, 50.0, 0.0), (20_000, 10))
    action = np.asarray(policy.distribution(logits, {}).sample(policy.noise(jax.random.key(0), (20_000,))))
    assert action.min() >= 3
    assert action.max() <= 4
    assert chisquare(np.histogram(action, 20, (3, 4))[0]).pvalue > 1e-3


def test_the_place_in_the_bin_does_not_depend_on_the_bin():
    policy = HistogramPolicy(n_bins=4, bin_sample="uniform").on(Box.of(np.array([0.0]), np.array([4.0])))
    distribution = policy.distribution(jnp.zeros((40_000, 4)), {})
    action = np.asarray(distribution.sample(policy.noise(jax.random.key(0), (40_000,))))[:, 0]
    for i in range(4):
        inside = action[(action > i) & (action < i + 1)]
        assert chisquare(np.histogram(inside, 10, (i, i + 1))[0]).pvalue > 1e-3


def test_large_logits_are_sampled_as_small_ones():
    logits, u = jax.random.normal(jax.random.key(0), (30,)), jnp.linspace(0.0, 0.999, 200)
    sample = jax.vmap(sample_bin, (None, 0))
    np.testing.assert_array_equal(sample(logits + 512, u), sample((logits + 512) - 512, u))


def test_deterministic_actions_are_mode_mean_and_median():
    bins = Bins(0.0, 4.0, 4)
    logits = jnp.log(jnp.array([[0.4, 0.05, 0.25, 0.3]]))
    actions = {
        how: float(Histogram(bins, logits, Choices(deterministic_action=how)).deterministic_action()[0])
        for how in ("mode", "mean", "median")
    }
    assert actions["mode"] == 0.5
    assert actions["median"] == 2.5
    assert actions["mean"] == pytest.approx(0.4 * 0.5 + 0.05 * 1.5 + 0.25 * 2.5 + 0.3 * 3.5)


def test_entropy_is_the_sum_over_dimensions():
    uniform = Histogram(Bins([0.0, 0.0], [1.0, 1.0], 8), jnp.zeros((2, 8)))
    np.testing.assert_allclose(uniform.entropy(), 2 * np.log(8), rtol=1e-6)


def test_gaussian_exploration_has_the_policys_moments_and_leaves_the_box():
    policy = HistogramPolicy(n_bins=40, exploration="gaussian").on(Box.of(np.array([3.0]), np.array([5.0])))
    logits = jax.random.normal(jax.random.key(2), (40,))
    probs, centers = np.asarray(jax.nn.softmax(logits), np.float64), policy.bins.centers[0]
    n = 200_000
    distribution = policy.distribution(jnp.broadcast_to(logits, (n, 40)), {})
    action = np.asarray(distribution.sample(policy.noise(jax.random.key(3), (n,))), np.float64)
    mean = (probs * centers).sum()
    std = np.sqrt((probs * (centers - mean) ** 2).sum())
    assert action.mean() == pytest.approx(mean, abs=5 * std / np.sqrt(n))
    assert action.std() == pytest.approx(std, rel=0.01)
    assert action.max() > 5


def test_the_log_density_of_gaussian_exploration_is_that_gaussians():
    bins, logits = Bins([-1.0, 0.0], [1.0, 4.0], 40), jax.random.normal(jax.random.key(4), (2, 40))
    probs, action = np.asarray(jax.nn.softmax(logits), np.float64), np.array([1.3, 2.2])
    mean = (probs * bins.centers).sum(-1)
    std = np.sqrt((probs * (bins.centers - mean[:, None]) ** 2).sum(-1))
    found = Histogram(bins, logits, Choices(exploration="gaussian")).log_prob(jnp.asarray(action, jnp.float32))
    assert float(found) == pytest.approx(norm.logpdf(action, mean, std).sum(), rel=1e-5)


def test_a_certain_policy_that_explores_by_a_gaussian_has_a_finite_log_density():
    logits = jnp.where(jnp.arange(10) == 3, 500.0, 0.0)[None]
    distribution = Histogram(Bins(0.0, 10.0, 10), logits, Choices(exploration="gaussian"))
    assert float(distribution.std()[0]) == 0
    assert np.isfinite(distribution.log_prob(distribution.mean()))


def test_init_gaussian_starts_like_the_gaussian_policy():
    policy = HistogramPolicy(n_bins=400, initial_policy="gaussian").on(Box.of(np.array([-4.0]), np.array([4.0])))
    probs = jax.nn.softmax(policy.init()[0])
    edges = np.linspace(-4, 4, 401)
    expected = np.diff(norm.cdf(edges))
    np.testing.assert_allclose(probs, expected / expected.sum(), atol=2e-6)


BOXES = [(-1.0, 1.0), (-3.0, 1.0), (2.0, 2.5), (-400.0, 1.0)]


@pytest.mark.slow
@pytest.mark.parametrize(("centers", "box_units"), [("inside", 0.0), ("bounds", 1.0)])
def test_it_starts_as_the_gaussians_clipped_actions_do(centers, box_units):
    low, high = np.array(BOXES).T
    start = HistogramPolicy(n_bins=30, initial_policy="clipped-gaussian", bin_centers=centers, box_units=box_units)
    for log_std in (0.0, -1.0, 2.0):
        policy = start.replace(log_std_init=log_std).on(Box.of(low, high))
        probs = policy.distribution(policy.init()[0], {}).probs
        mean, std = np.zeros(4), np.exp(log_std) * np.ones(4)
        if box_units:
            mean, std = (low + high) / 2, std * (high - low) / 2
        edges = policy.bins.edges.astype(np.float64)
        edges[:, 0], edges[:, -1] = -np.inf, np.inf
        z = (edges - mean[:, None]) / std[:, None]
        expected = np.where(z[:, :-1] > 0, -np.diff(norm.sf(z)), np.diff(norm.cdf(z)))
        np.testing.assert_allclose(probs, expected, rtol=2e-3, atol=2e-6)


def test_the_first_gaussian_is_the_one_that_the_numbers_say():
    low, high = np.array([0.0]), np.array([8.0])
    policy = HistogramPolicy(n_bins=400, initial_policy="gaussian").on(Box.of(low, high))
    centers = policy.bins.centers[0]
    for numbers, mean, std in (({}, 0, 1), ({"log_std_init": -1.0, "box_units": 1.0}, 4, 4 / np.e)):
        density = norm.pdf(centers, mean, std)
        found = jax.nn.softmax(policy.replace(**numbers).init()[0])
        np.testing.assert_allclose(found, density / density.sum(), atol=2e-6)
    floored, there = policy.replace(log_std_init=-9.0, log_std_min=-1.0, box_units=1.0), policy.replace(**numbers)
    np.testing.assert_array_equal(floored.init()[0], there.init()[0])


@pytest.mark.parametrize("log_std", [-12.0, 8.0])
@pytest.mark.parametrize("start", ["gaussian", "clipped-gaussian"])
def test_a_start_of_any_width_is_finite(start, log_std):
    low, high = np.array(BOXES).T
    policy = HistogramPolicy(n_bins=100, initial_policy=start, log_std_init=log_std).on(Box.of(low, high))
    for box_units in (0.0, 1.0):
        assert np.isfinite(policy.replace(box_units=box_units).init()[0]).all()


@pytest.mark.slow
def test_with_centers_on_the_bounds_a_place_is_drawn_in_the_bins_own_width():
    box = Box.of(np.array([0.0]), np.array([8.0]))
    policy = HistogramPolicy(n_bins=5, bin_sample="uniform", bin_centers="bounds").on(box)
    for bin_, (low, high) in {0: (0, 1), 2: (3, 5), 4: (7, 8)}.items():
        logits = jnp.broadcast_to(jnp.where(jnp.arange(5) == bin_, 50.0, 0.0), (5_000, 5))
        distribution = policy.distribution(logits, {})
        action = distribution.sample(policy.noise(jax.random.key(0), (5_000,)))
        assert action.min() >= low
        assert action.max() <= high
        assert chisquare(np.histogram(action, 10, (low, high))[0]).pvalue > 1e-3
        assert distribution.at_edge(action).all() == (bin_ != 2)


@pytest.mark.slow
def test_centers_on_the_bounds_are_the_actions():
    policy = HistogramPolicy(n_bins=5, bin_centers="bounds").on(Box.of(np.array([-1.0]), np.array([3.0])))
    certain = policy.distribution(50.0 * jnp.eye(5), {})
    np.testing.assert_allclose(certain.deterministic_action()[:, 0], [-1, 0, 1, 2, 3])
    np.testing.assert_allclose(certain.sample(jnp.full((5, 1), 0.5))[:, 0], [-1, 0, 1, 2, 3])
