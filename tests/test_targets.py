import subprocess
import sys

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.stats import norm

from galton import Bins, UsageError, targets

ETAS = [0.01, 0.05, 0.1, 0.25, 0.5, 0.75, 1.0, 2.0, 4.0]
BOXES = [(-1.0, 1.0), (-10.0, 10.0), (0.1, 0.7), (-3.3, 12.9)]


def places(bins):
    """Actions inside, on and far beyond the edges."""
    rng = np.random.default_rng(0)
    low, high = bins.low[0], bins.high[0]
    inside = rng.uniform(low, high, 40).astype(np.float32)
    beyond = np.array([low - 1e-3, high + 1e-3, low - 50, high + 50, -1e30, 1e30], np.float32)
    some = rng.choice(bins.n_bins, min(bins.n_bins, 100), replace=False)
    edges, centers = np.append(bins.edges[0, some], bins.high), bins.centers[0, some]
    near = np.nextafter(edges, np.float32(-np.inf))
    return jnp.asarray(np.concatenate([inside, edges, near, centers, beyond])[:, None])


def reference(low, high, k, action, eta):
    """scipy's normal CDF in float64, on exact edges, with survival functions where they are more accurate."""
    edges = np.linspace(low, high, k + 1)
    z = (edges - np.clip(np.asarray(action, np.float64), low, high)) / (eta * (high - low) / k)
    mass = np.where(z[:, :-1] > 0, norm.sf(z[:, :-1]) - norm.sf(z[:, 1:]), norm.cdf(z[:, 1:]) - norm.cdf(z[:, :-1]))
    return mass / mass.sum(1, keepdims=True)


@pytest.mark.parametrize("k", [2, 3, 50, 100, 200, 1000, 4096])
@pytest.mark.parametrize("eta", ETAS)
def test_hl_gauss_is_a_distribution_in_float32(k, eta):
    for low, high in BOXES[:3]:
        bins = Bins(low, high, k)
        q = np.asarray(targets.hl_gauss(bins, places(bins), eta))
        assert q.dtype == np.float32
        assert np.isfinite(q).all()
        assert (q >= 0).all()
        np.testing.assert_allclose(q.astype(np.float64).sum(-1), 1, atol=1e-6)


@pytest.mark.parametrize("k", [2, 3, 50, 100, 200, 4096])
@pytest.mark.parametrize("eta", ETAS)
@pytest.mark.parametrize(("low", "high"), BOXES)
def test_hl_gauss_equals_scipys_normal_cdf(k, eta, low, high, trust):
    bins = Bins(low, high, k)
    action = places(bins)
    q = targets.hl_gauss(bins, action, eta)[:, 0]
    # What a float32 action can't say of a float64 bound: 6e-8 of it, in widths of the target.
    unsayable = 6e-8 * max(abs(low), abs(high)) / (eta * (high - low) / k)
    inside = (np.asarray(action) > bins.low) & (np.asarray(action) < bins.high)
    error = np.abs(np.asarray(q, np.float64) - reference(low, high, k, action, eta))
    worst = error[inside[:, 0]].max()
    assert worst < 1e-6
    assert error.max() < 1e-6 + unsayable
    promise = "The targets of HL-Gauss, computed in float32, are those of scipy's normal distribution in float64."
    trust("targets", promise, topic="numbers", figure=worst, unit="apart in the mass of a bin", at_most=1e-6)


@pytest.mark.parametrize("eta", ETAS)
def test_hl_gauss_equals_scipys_normal_cdf_in_float64(eta):
    with jax.enable_x64(True):
        bins = Bins(-3.3, 12.9, 100)
        action = jnp.linspace(-5, 15, 997)[:, None]
        q = targets.hl_gauss(bins, action, eta)[:, 0]
        np.testing.assert_allclose(q, reference(-3.3, 12.9, 100, action, eta), atol=1e-12)


@pytest.mark.slow
@pytest.mark.parametrize("k", [2, 50, 200])
@pytest.mark.parametrize("eta", [0.01, 0.05, 0.1])
def test_narrow_targets_are_one_hot_at_bin_centers(k, eta):
    bins = Bins([-1.0, 2.0], [1.0, 7.0], k)
    action = jnp.asarray(bins.centers.T)
    np.testing.assert_allclose(targets.hl_gauss(bins, action, eta), targets.one_hot(bins, action), atol=1e-5)


@pytest.mark.parametrize("k", [2, 7, 100, 200])
@pytest.mark.parametrize("eta", ETAS)
def test_the_short_cut_for_centers_equals_the_general_target(k, eta):
    bins = Bins(-1.0, 1.0, k)
    general = targets.hl_gauss(bins, jnp.asarray(bins.centers.T), eta)[:, 0]
    np.testing.assert_allclose(targets.hl_gauss_of_center(k, jnp.arange(k), eta), general, atol=2e-6)


LAYOUTS = [(tails, centers) for tails in ("rescaled", "edges") for centers in ("inside", "bounds")]


@pytest.mark.few
@pytest.mark.parametrize("k", [2, 7, 100])
@pytest.mark.parametrize(("tails", "centers"), LAYOUTS)
def test_every_layout_is_scipys_gaussian_over_its_bins(tails, centers, k):
    low, high, etas = -3.3, 12.9, np.array([0.05, 0.5, 1.0, 4.0])
    bins = Bins(low, high, k, centers)
    action = jnp.concatenate([jnp.linspace(-5, 15, 31), jnp.asarray(bins.centers[0])])[:, None]

    def both(eta):
        whole = targets.hl_gauss(bins, action, eta, tails)[:, 0]
        return whole, targets.hl_gauss_of_center(k, jnp.arange(k), eta, tails, centers)

    whole, short = jax.jit(jax.vmap(both))(jnp.float32(etas))
    for i, eta in enumerate(etas):
        expected = layout(low, high, k, centers, tails, action, eta)
        np.testing.assert_allclose(whole[i], expected, atol=1e-5 / eta)
        np.testing.assert_allclose(short[i], expected[31:], atol=2e-6 / eta)
    for found in (whole, short):
        np.testing.assert_allclose(found.sum(-1), 1, atol=1e-6)
        assert (found >= 0).all()


def layout(low, high, k, centers, tails, action, eta):
    """scipy's normal distribution over the bins of a layout, in float64."""
    edges, width = np.linspace(low, high, k + 1), (high - low) / k
    if centers == "bounds":
        middles, width = np.linspace(low, high, k), (high - low) / (k - 1)
        edges = np.concatenate([[low], (middles[1:] + middles[:-1]) / 2, [high]])
    z = (edges - np.clip(np.asarray(action, np.float64), low, high)) / (eta * width)
    if tails == "edges":
        z[:, 0], z[:, -1] = -np.inf, np.inf
    mass = np.where(z[:, :-1] > 0, norm.sf(z[:, :-1]) - norm.sf(z[:, 1:]), norm.cdf(z[:, 1:]) - norm.cdf(z[:, :-1]))
    return mass / mass.sum(1, keepdims=True)


def test_edges_get_what_a_rescaled_target_divides_away():
    bins = Bins(-1.0, 1.0, 10)
    at_the_end = jnp.asarray(bins.high)
    rescaled, edges = (np.asarray(targets.hl_gauss(bins, at_the_end, 1.0, tails))[0] for tails in ("rescaled", "edges"))
    assert edges[-1] == pytest.approx(norm.cdf(1.0), abs=1e-6)  # half of it lies beyond the box
    assert rescaled[-1] == pytest.approx(2 * norm.cdf(1.0) - 1, abs=1e-6)
    np.testing.assert_allclose(edges[:-1], rescaled[:-1] / 2, atol=1e-6)


@pytest.mark.slow
def test_each_dimension_has_its_own_bounds_and_any_batch_shape():
    bins = Bins([-1.0, 0.0, -5.0], [1.0, 10.0, -4.0], 20)
    action = jax.random.uniform(jax.random.key(0), (3, 5, 3), minval=-6, maxval=11)
    whole = targets.hl_gauss(bins, action, 0.75)
    for i in range(3):
        alone = targets.hl_gauss(Bins(bins.low[i], bins.high[i], 20), action[..., i : i + 1], 0.75)
        np.testing.assert_allclose(whole[..., i, :], alone[..., 0, :], atol=1e-6)
    assert targets.one_hot(bins, action).shape == (3, 5, 3, 20)


MISSPELT = """
import jax.numpy as jnp
from galton import Bins
from galton.targets import hl_gauss, hl_gauss_of_center, mean_of_centers
bins, action = Bins(-1.0, 1.0, 5), jnp.zeros(1)
for call in (
    lambda: Bins(-1.0, 1.0, 5, "bound"),
    lambda: hl_gauss(bins, action, 1.0, "edge"),
    lambda: hl_gauss_of_center(5, jnp.array(2), 1.0, "edge"),
    lambda: mean_of_centers(jnp.ones((1, 5)) / 5, jnp.ones(1), "rescaled", "bound"),
):
    try:
        print(call())
    except ValueError as error:
        print(error)
"""


@pytest.mark.slow
def test_a_misspelt_layout_is_refused_where_types_are_not_checked_too():
    done = subprocess.run([sys.executable, "-c", MISSPELT], capture_output=True, text=True, check=True)
    assert done.stdout.splitlines() == [
        "bin_centers is 'bound'; choose from inside, bounds; did you mean bounds?",
        "tails is 'edge'; choose from rescaled, edges; did you mean edges?",
        "tails is 'edge'; choose from rescaled, edges; did you mean edges?",
        "centers is 'bound'; choose from inside, bounds; did you mean bounds?",
    ]


def test_eta_must_be_positive():
    with pytest.raises(UsageError, match="eta is 0"):
        targets.hl_gauss(Bins(-1, 1, 10), jnp.zeros(1), 0)
    with pytest.raises(UsageError, match="eta is -1"):
        targets.hl_gauss_of_center(10, jnp.arange(10), -1.0)


def rows_of(k, eta, tails, centers):
    """K in float64: row j is the target of bin j's center, in bin widths."""
    center, edge = np.arange(k) + 0.5, np.arange(k + 1.0)
    if centers == "bounds":
        edge[[0, -1]] = center[[0, -1]]
    if tails == "edges":
        edge[[0, -1]] = -np.inf, np.inf
    z = (edge - center[:, None]) / eta
    mass = np.where(z[:, :-1] > 0, norm.sf(z[:, :-1]) - norm.sf(z[:, 1:]), norm.cdf(z[:, 1:]) - norm.cdf(z[:, :-1]))
    return mass / mass.sum(1, keepdims=True)


@pytest.mark.slow
@pytest.mark.parametrize("k", [2, 41, *(pytest.param(k, marks=pytest.mark.slow) for k in (3, 100))])
@pytest.mark.parametrize("tails", ["rescaled", "edges"])
@pytest.mark.parametrize("centers", ["inside", "bounds"])
def test_an_eta_for_each_entry_gives_each_its_own_target_and_mean(k, tails, centers):
    rng = np.random.default_rng(k)
    eta, pi = np.exp(rng.uniform(np.log(0.05), np.log(30), (5, 3))), rng.dirichlet(np.ones(k) / 3, (5, 3))
    index = rng.integers(0, k, (5, 3))
    targets_of = np.array([[rows_of(k, eta[i, j], tails, centers) for j in range(3)] for i in range(5)])
    chosen = np.take_along_axis(targets_of, index[..., None, None], 2)[..., 0, :]
    for x64, close in ((False, 1e-6), (True, 1e-13)):
        with jax.enable_x64(x64):
            width, bins = jnp.asarray(eta, float), Bins([0.0] * 3, [1.0, 7.0, 1e3], k, centers)
            found = targets.hl_gauss_of_center(k, jnp.asarray(index), width, tails, centers)
            np.testing.assert_allclose(found, chosen, atol=close)
            found = targets.hl_gauss(bins, bins.decode(jnp.asarray(index)), width, tails)
            np.testing.assert_allclose(found, chosen, atol=5 * close)
            mean = targets.mean_of_centers(jnp.asarray(pi, float), width, tails, centers)
            np.testing.assert_allclose(mean, np.einsum("ijk,ijkl->ijl", pi, targets_of), atol=close)
            for i in range(2):
                alone = targets.mean_of_centers(jnp.asarray(pi[i, 0], float), float(eta[i, 0]), tails, centers)
                np.testing.assert_allclose(mean[i, 0], alone, atol=close)
