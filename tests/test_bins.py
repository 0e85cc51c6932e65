import jax
import jax.numpy as jnp
import numpy as np
import pytest

from galton import Bins, UsageError

RNG = np.random.default_rng(0)
LOW = np.concatenate([RNG.uniform(-100, 100, 200), RNG.integers(-100, 100, 200), [0.0]])
HIGH = LOW + np.concatenate([RNG.uniform(1, 200, 200), RNG.integers(1, 200, 200), [1.0]])
"""The dimensions of one box: bounds that float32 can hold, and others."""
sizes = pytest.mark.parametrize("k", [2, 3, 10, 100, 257])
layouts = pytest.mark.parametrize("bin_centers", ["inside", "bounds"])


def encoded(bins, *actions):
    """The indices of several `[n, d]`, one below the other."""
    return np.asarray(jax.jit(bins.encode)(np.concatenate(actions)))


def column(index):
    return np.tile(np.asarray(index)[:, None], (1, len(LOW)))


@sizes
@layouts
def test_a_center_belongs_to_its_bin_an_edge_to_the_bin_above_and_high_to_the_last(k, bin_centers):
    bins = Bins(LOW, HIGH, k, bin_centers)
    centers = np.asarray(bins.decode(jnp.asarray(column(range(k)))))
    np.testing.assert_array_equal(centers, bins.centers.T)
    expected = np.concatenate([np.arange(k), np.minimum(np.arange(k + 1), k - 1)])
    np.testing.assert_array_equal(encoded(bins, centers, bins.edges.T), column(expected))


@pytest.mark.slow
@sizes
@layouts
def test_an_index_is_the_number_of_inner_edges_at_or_below_by_numpy(k, bin_centers):
    bins = Bins(LOW, HIGH, k, bin_centers)
    beside = [np.nextafter(bins.edges.T, np.float32(end)) for end in (-np.inf, np.inf)]
    inside = RNG.uniform(bins.low, bins.high, (50, len(bins.low))).astype(np.float32)
    action = np.concatenate([inside, bins.edges.T, *beside])
    action[abs(action) < np.finfo(np.float32).tiny] = 0  # XLA takes them for 0
    expected = [
        np.searchsorted(edges[1:-1], one, side="right") for edges, one in zip(bins.edges, action.T, strict=True)
    ]
    np.testing.assert_array_equal(encoded(bins, action), np.transpose(expected))


@pytest.mark.few
@sizes
def test_beyond_the_box_is_the_bin_at_that_end(k):
    bins, far = Bins(LOW, HIGH, k), np.float32([[1e-3], [1.0], [1e30]])
    np.testing.assert_array_equal(encoded(bins, bins.low - far, bins.high + far), column([0] * 3 + [k - 1] * 3))


def test_edges_centers_and_width_are_the_uniform_discretisation():
    bins = Bins([-1.0, 0.0], [1.0, 10.0], 4)
    np.testing.assert_allclose(bins.edges, [[-1, -0.5, 0, 0.5, 1], [0, 2.5, 5, 7.5, 10]])
    np.testing.assert_allclose(bins.centers, [[-0.75, -0.25, 0.25, 0.75], [1.25, 3.75, 6.25, 8.75]])
    np.testing.assert_allclose(bins.width, [0.5, 2.5])


def test_scalar_bounds_make_one_dimension():
    assert Bins(-2, 2, 8).centers.shape == (1, 8)


@sizes
def test_with_centers_on_the_bounds_edges_are_half_way_and_the_bins_at_the_ends_half_as_wide(k):
    bins, width = Bins(LOW, HIGH, k, "bounds"), (HIGH - LOW) / (k - 1)
    tolerance = {"rtol": 1e-5, "atol": 1e-5 * abs(np.stack([LOW, HIGH])).max()}
    for places in (bins.centers, bins.edges):
        np.testing.assert_array_equal(places[:, [0, -1]], np.float32(np.stack([LOW, HIGH], -1)))
    np.testing.assert_allclose(np.diff(bins.centers), np.tile(width[:, None], k - 1), **tolerance)
    np.testing.assert_allclose(bins.edges[:, 1:-1], (bins.centers[:, 1:] + bins.centers[:, :-1]) / 2, **tolerance)
    np.testing.assert_allclose(bins.width, width, rtol=1e-6)
    shares = np.full(k, 1.0)
    shares[[0, -1]] = 0.5
    np.testing.assert_allclose(np.diff(bins.edges), width[:, None] * shares, **tolerance)


@pytest.mark.parametrize(
    ("low", "high", "n_bins", "message"),
    [
        ([0], [1], 1, "n_bins is 1"),
        ([1], [1], 4, "below its high"),
        ([2], [1], 4, "below its high"),
        ([-np.inf], [1], 4, "finite bounds"),
        ([0], [np.nan], 4, "finite bounds"),
        ([0, 0], [1], 4, "both must be"),
        (np.zeros((1, 1)), np.ones((1, 1)), 4, "both must be"),
        ([1e6], [1e6 + 1], 100, "too narrow"),
    ],
)
def test_bad_bounds_are_refused_by_name(low, high, n_bins, message):
    with pytest.raises(UsageError, match=message):
        Bins(low, high, n_bins)
