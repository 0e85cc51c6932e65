import itertools
import typing

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.special import ndtr

from galton import Bins, UsageError, targets

ETAS = [0.01, 0.05, 0.1, 0.25, 0.5, 0.75, 1.0, 2.0, 4.0]
BOXES = [(-1.0, 1.0), (-10.0, 10.0), (0.1, 0.7), (-3.3, 12.9)]


def places(low, high, k):
    """Actions inside, on and far beyond the edges."""
    rng, bins = np.random.default_rng(0), Bins(low, high, k)
    inside = rng.uniform(*bins.low, *bins.high, 40).astype(np.float32)
    beyond = np.array([low - 1e-3, high + 1e-3, low - 50, high + 50, -1e30, 1e30], np.float32)
    some = rng.choice(k, min(k, 100), replace=False)
    edges, centers = np.append(bins.edges[0, some], bins.high), bins.centers[0, some]
    near = np.nextafter(edges, np.float32(-np.inf))
    return np.concatenate([inside, edges, near, centers, beyond])


def reference(low, high, k, action, eta, tails="rescaled", centers="inside"):
    """scipy's normal distribution over exact bins in float64, from the side on which it has digits left."""
    edges, width = np.linspace(low, high, k + 1), (high - low) / k
    if centers == "bounds":
        middles, width = np.linspace(low, high, k), (high - low) / (k - 1)
        edges = np.concatenate([[low], (middles[1:] + middles[:-1]) / 2, [high]])
    z = (edges - np.clip(np.asarray(action, np.float64), low, high)[:, None]) / (eta * width)
    if tails == "edges":
        z[:, 0], z[:, -1] = -np.inf, np.inf
    mass = np.where(z[:, :-1] > 0, -np.diff(ndtr(-z)), np.diff(ndtr(z)))
    return mass / mass.sum(1, keepdims=True)


@pytest.mark.parametrize("k", [2, 3, 50, 100, 200, 1000, 4096])
def test_hl_gauss_equals_scipys_normal_cdf(k, trust):
    bins = Bins(*np.transpose(BOXES), k)
    action = np.stack([places(low, high, k) for low, high in BOXES], -1)
    inside, worst = (action > bins.low) & (action < bins.high), 0.0
    target = jax.jit(lambda eta: targets.hl_gauss(bins, action, eta))
    for eta in ETAS:
        q = np.asarray(target(np.float32(eta)))
        assert q.dtype == np.float32
        assert (q >= 0).all()
        np.testing.assert_allclose(q.sum(-1, dtype=np.float64), 1, atol=1e-6)
        for i, (low, high) in enumerate(BOXES):
            # What a float32 action can't say of a float64 bound: 6e-8 of it, in widths of the target.
            unsayable = 6e-8 * max(abs(low), abs(high)) / (eta * (high - low) / k)
            error = np.abs(q[:, i] - reference(low, high, k, action[:, i], eta))
            worst = max(worst, error[inside[:, i]].max())
            assert error.max() < 1e-6 + unsayable
    assert worst < 1e-6
    promise = "The targets of HL-Gauss, computed in float32, are those of scipy's normal distribution in float64."
    trust("targets", promise, topic="numbers", figure=worst, unit="apart in the mass of a bin", at_most=1e-6)


def test_hl_gauss_equals_scipys_normal_cdf_in_float64():
    with jax.enable_x64(True):
        bins, action = Bins(-3.3, 12.9, 100), np.linspace(-5, 15, 997)
        target = jax.jit(lambda eta: targets.hl_gauss(bins, action[:, None], eta))
        for eta in ETAS:
            np.testing.assert_allclose(target(eta)[:, 0], reference(-3.3, 12.9, 100, action, eta), atol=1e-12)


LAYOUTS = [
    (k, *layout)
    for k in (7, 100, 200, 2)
    for layout in itertools.product(("rescaled", "edges"), typing.get_args(targets.Centers))
]
FAST = [(7, "edges", "bounds"), *((k, "rescaled", "inside") for k in (2, 7, 100, 200))]


@pytest.mark.parametrize(
    ("k", "tails", "centers"), [pytest.param(*one, marks=[pytest.mark.slow] * (one not in FAST)) for one in LAYOUTS]
)
def test_every_layout_is_scipys_gaussian_over_its_bins_and_so_is_the_short_cut_for_centers(k, tails, centers):
    low, high = (-1.0, 1.0) if k == 200 else (-3.3, 12.9)  # with so many bins rounding shows in the larger box
    bins = Bins(low, high, k, centers)
    action = np.concatenate([np.linspace(-5, 15, 31, dtype=np.float32), bins.centers[0]])

    def both(eta):
        whole = targets.hl_gauss(bins, action[:, None], eta, tails)[:, 0]
        return whole, targets.hl_gauss_of_center(k, jnp.arange(k), eta, tails, centers)

    for eta, whole, short in zip(ETAS, *jax.jit(jax.vmap(both))(np.float32(ETAS)), strict=True):
        expected = reference(low, high, k, action, eta, tails, centers)
        np.testing.assert_allclose(whole, expected, atol=1e-5 / eta)
        np.testing.assert_allclose(short, expected[31:], atol=2e-6 / eta)
        np.testing.assert_allclose(short, whole[31:], atol=2e-6)
        for found in (whole, short):
            np.testing.assert_allclose(found.sum(-1), 1, atol=1e-6)
            assert (found >= 0).all()


def test_eta_must_be_positive():
    with pytest.raises(UsageError, match="eta is 0"):
        targets.hl_gauss(Bins(-1, 1, 10), jnp.zeros(1), 0)
    with pytest.raises(UsageError, match="eta is -1"):
        targets.hl_gauss_of_center(10, jnp.arange(10), -1.0)


def rows_of(k, eta, tails, centers):
    """K in float64: row j is the target of bin j's center, in bin widths."""
    first = 0.5 if centers == "bounds" else 0.0
    return reference(first, k - first, k, np.arange(k) + 0.5, eta, tails, centers)


@pytest.mark.slow
@pytest.mark.parametrize("k", [2, 3, 41, 100])
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
