import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from galton import Bins, UsageError


@st.composite
def boxes(draw):
    d = draw(st.sampled_from([1, 3]))
    low = np.array([draw(st.floats(-100, 100)) for _ in range(d)])
    span = np.array([draw(st.floats(1, 200)) for _ in range(d)])
    return low, low + span, draw(st.sampled_from([2, 3, 10, 100, 257]))


@settings(max_examples=100)
@given(boxes())
def test_decode_then_encode_gives_every_index_back(box):
    bins = Bins(*box)
    index = np.tile(np.arange(bins.n_bins)[:, None], (1, len(bins.low)))
    np.testing.assert_array_equal(bins.encode(bins.decode(jnp.asarray(index))), index)


@settings(max_examples=100)
@given(boxes())
def test_a_value_on_an_edge_belongs_to_the_bin_above_and_high_to_the_last(box):
    bins = Bins(*box)
    expected = np.minimum(np.arange(bins.n_bins + 1), bins.n_bins - 1)
    np.testing.assert_array_equal(
        bins.encode(jnp.asarray(bins.edges.T)), np.tile(expected[:, None], (1, len(bins.low)))
    )


@pytest.mark.slow
@settings(max_examples=100)
@given(boxes(), st.integers(0, 2**32 - 1), st.sampled_from(["inside", "bounds"]))
def test_an_index_is_the_number_of_inner_edges_at_or_below_by_numpy(box, seed, bin_centers):
    bins = Bins(*box, bin_centers=bin_centers)
    beside = [np.nextafter(bins.edges, np.float32(end)) for end in (-np.inf, np.inf)]
    inside = np.random.default_rng(seed).uniform(bins.low, bins.high, (50, len(bins.low))).astype(np.float32)
    action = np.concatenate([inside, bins.edges.T, *(edges.T for edges in beside)])
    action[abs(action) < np.finfo(np.float32).tiny] = 0  # XLA takes them for 0
    expected = [
        np.searchsorted(edges[1:-1], one, side="right") for edges, one in zip(bins.edges, action.T, strict=True)
    ]
    np.testing.assert_array_equal(bins.encode(jnp.asarray(action)), np.transpose(expected))


@pytest.mark.slow
@settings(max_examples=50)
@given(boxes(), st.floats(1e-3, 1e30))
def test_beyond_the_box_is_the_bin_at_that_end(box, distance):
    bins = Bins(*box)
    far = np.float32(distance)
    assert (np.asarray(bins.encode(jnp.asarray(bins.low - far))) == 0).all()
    assert (np.asarray(bins.encode(jnp.asarray(bins.high + far))) == bins.n_bins - 1).all()


def test_edges_centers_and_width_are_the_uniform_discretisation():
    bins = Bins([-1.0, 0.0], [1.0, 10.0], 4)
    np.testing.assert_allclose(bins.edges, [[-1, -0.5, 0, 0.5, 1], [0, 2.5, 5, 7.5, 10]])
    np.testing.assert_allclose(bins.centers, [[-0.75, -0.25, 0.25, 0.75], [1.25, 3.75, 6.25, 8.75]])
    np.testing.assert_allclose(bins.width, [0.5, 2.5])


def test_scalar_bounds_make_one_dimension():
    assert Bins(-2, 2, 8).centers.shape == (1, 8)


@settings(max_examples=50)
@given(boxes())
def test_with_centers_on_the_bounds_edges_are_half_way_and_the_bins_at_the_ends_half_as_wide(box):
    low, high, k = box
    bins = Bins(low, high, k, "bounds")
    width = (high - low) / (k - 1)
    tolerance = {"rtol": 1e-5, "atol": 1e-5 * abs(np.concatenate(box[:2])).max()}
    np.testing.assert_array_equal(bins.centers[:, [0, -1]], np.float32(np.stack([low, high], -1)))
    np.testing.assert_array_equal(bins.edges[:, [0, -1]], np.float32(np.stack([low, high], -1)))
    np.testing.assert_allclose(np.diff(bins.centers), np.tile(width[:, None], k - 1), **tolerance)
    np.testing.assert_allclose(bins.edges[:, 1:-1], (bins.centers[:, 1:] + bins.centers[:, :-1]) / 2, **tolerance)
    np.testing.assert_allclose(bins.width, width, rtol=1e-6)
    shares = np.full(k, 1.0)
    shares[[0, -1]] = 0.5
    np.testing.assert_allclose(np.diff(bins.edges), width[:, None] * shares, **tolerance)
    index = np.tile(np.arange(k)[:, None], (1, len(low)))
    np.testing.assert_array_equal(bins.encode(bins.decode(jnp.asarray(index))), index)


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
