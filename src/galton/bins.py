"""The bins of a box: uniform ones (§4.1), ones whose outermost centers are bounds, a grid's cells, or users' own."""

import dataclasses
from collections.abc import Sequence
from typing import Any, Literal

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int

from galton.errors import require, require_integer, require_word
from galton.fields import as_numbers

MU = 255
"""The μ of telephony (ITU-T G.711): in the middle bins of a μ-law are 1 + μ times as fine as at the bounds."""
Centers = Literal["inside", "bounds"]
Bound = float | int | Sequence[float | int] | np.ndarray | np.generic


@dataclasses.dataclass(frozen=True, init=False, eq=False)
class Bins:
    """k bins of equal width in each of d action dimensions.

    Bin i holds low + i·width ≤ action < low + (i + 1)·width: a value on an inner edge belongs to the bin above
    it, `high` to the last bin, and what lies outside the box to the bin at that end.

    With bin_centers="bounds" the centers are low + i·width with width = (high − low) / (k − 1), so that the first and
    the last are the bounds themselves. The edges lie half-way between centers. The bins at the ends stop at the bounds
    and are half as wide as the others.

    Args:
        low: the box's lower bounds, `[d]` or a scalar for d = 1.
        high: its upper bounds, of the same shape. Bounds may differ per dimension and need not be symmetric.
        n_bins: k, at least 2.
        bin_centers: "inside" for bins that are all of one width, or "bounds".

    Raises:
        UsageError: bounds that are no numbers, not finite, not ordered, or too close for k bins in this precision.
    """

    low: Float[np.ndarray, " d"]
    """The box's lower bounds."""
    high: Float[np.ndarray, " d"]
    """The box's upper bounds."""
    n_bins: int
    """The number of bins in each dimension, k."""
    edges: Float[np.ndarray, "d k+1"]
    """The bins' k + 1 edges, from the box's lower bound to its upper bound."""
    edges_rest: Float[np.ndarray, "d k+1"]
    """The part of the edges that rounding took: edges + edges_rest is exact to twice the precision."""
    centers: Float[np.ndarray, "d k"]
    """The action that each bin stands for: its middle, or the bound itself where a bin at an end stands for that."""
    width: Float[np.ndarray, " d"]
    """The distance between two centers, which is the width of all bins but of those that end at a bound's center."""
    bin_centers: Centers
    """The place of the centers of the first and last bin: inside the box, or on its bounds."""

    def __init__(self, low: Bound, high: Bound, n_bins: int, bin_centers: Centers = "inside") -> None:
        low64, high64 = (np.atleast_1d(as_numbers(*bound)) for bound in (("low", low), ("high", high)))
        bounds = f"low is {low64} and high is {high64}"
        require(
            low64.shape == high64.shape and low64.ndim == 1,
            f"low has shape {low64.shape} and high {high64.shape}; both must be [d]",
        )
        require(
            np.isfinite(low64).all() and np.isfinite(high64).all(),
            f"{bounds}; a box that is cut into bins needs finite bounds",
        )
        require((low64 < high64).all(), f"{bounds}; each low must lie below its high")
        require_integer("n_bins", n_bins, 2)
        require_word("bin_centers", bin_centers, ("inside", "bounds"))
        dtype = jax.dtypes.canonicalize_dtype(np.float64)
        on_bounds = bin_centers == "bounds"
        width = (high64 - low64) / (n_bins - on_bounds)
        spacing = np.finfo(dtype).eps * np.maximum(abs(low64), abs(high64))
        require(
            (width > 4 * spacing).all(),
            f"{bounds}; {n_bins} bins between them are too narrow for {dtype.name}; lower n_bins or shift the box",
        )
        edges = np.linspace(low64, high64, n_bins + 1, axis=-1)
        centers = (edges[:, 1:] + edges[:, :-1]) / 2
        if on_bounds:
            centers = np.linspace(low64, high64, n_bins, axis=-1)
            middles = (centers[:, 1:] + centers[:, :-1]) / 2
            edges = np.concatenate([low64[:, None], middles, high64[:, None]], axis=-1)
        arrays = {"low": low64, "high": high64, "edges": edges, "centers": centers, "width": width}
        arrays["edges_rest"] = edges - edges.astype(dtype)
        own = {name: value.astype(dtype) for name, value in arrays.items()}
        vars(self).update(own | {"n_bins": n_bins, "bin_centers": bin_centers})

    def encode(self, action: Float[Array, "*batch d"]) -> Int[Array, "*batch d"]:
        """The index, 0 … k − 1, of the bin that holds each entry of an action.

        Arithmetic finds it, off by one at most, and the two edges beside it say which: what comes out is the number of
        inner edges at or below the action, in less time than it takes to count them.
        """
        half = 0.5 if self.bin_centers == "bounds" else 0.0
        near = jnp.clip((action - self.low) / self.width + half, 0, self.n_bins - 1).astype(int)
        inner = jnp.pad(self.edges[:, 1:-1], ((0, 0), (1, 1)), constant_values=jnp.nan)  # nothing is beyond the ends
        below, above = (inner[jnp.arange(len(self.low)), near + i] for i in (0, 1))
        return near - (action < below) + (action >= above)

    def decode(self, index: Int[Array, "*batch softmaxes"]) -> Float[Array, "*batch d"]:
        """The center of each indexed bin."""
        return jnp.asarray(self.centers)[jnp.arange(len(self.low)), index]

    def within(self, index: Int[Array, "*batch d"], share: Float[Array, "*batch d"]) -> Float[Array, "*batch d"]:
        """The action so far up in each indexed bin, from 0 at its lower edge to 1 at its upper one."""
        if self.bin_centers == "bounds":
            lower, upper = (jnp.asarray(self.edges)[jnp.arange(len(self.low)), index + i] for i in (0, 1))
            return lower + (upper - lower) * share
        return self.decode(index) + self.width * (share - 0.5)

    def only(self, i: int) -> "Bins":
        """The bins of one dimension."""
        own = object.__new__(Bins)
        vars(own).update({n: x[i : i + 1] if isinstance(x, np.ndarray) else x for n, x in vars(self).items()})
        return own

    def clip(self, action: Float[Array, "*batch d"]) -> Float[Array, "*batch d"]:
        """The nearest action inside the box."""
        return jnp.clip(action, self.low, self.high)

    def at_edge(self, action: Float[Array, "*batch d"]) -> Bool[Array, "*batch d"]:
        """Return True for entries in the first or last bin of a dimension, or beyond."""
        return (action < self.edges[:, 1]) | (action >= self.edges[:, -2])


class GridBins(Bins):
    """The cells of a grid over all d dimensions as the bins of a single choice, k^d of them.

    The last dimension counts fastest: the cell of the bins i_1, …, i_d has the index i_1 k^(d − 1) + … + i_d. Edges and
    width are those of a dimension's bins; n_bins is k^d, centers are `[d, k^d]`, and indices `[*batch, 1]`.

    Args:
        axes: the k bins of each dimension.
    """

    axes: Bins
    """The k bins of each dimension."""

    def __init__(self, axes: Bins) -> None:
        d, k = axes.centers.shape
        centers = np.stack(np.meshgrid(*axes.centers, indexing="ij")).reshape(d, -1)
        vars(self).update(vars(axes) | {"axes": axes, "n_bins": k**d, "centers": centers})

    def encode(self, action: Float[Array, "*batch d"]) -> Int[Array, "*batch 1"]:
        """The index, 0 … k^d − 1, of the cell that holds an action."""
        d, k = self.axes.centers.shape
        return (self.axes.encode(action) * k ** np.arange(d)[::-1]).sum(-1, keepdims=True)

    def within(self, index: Int[Array, "*batch 1"], share: Float[Array, "*batch d"]) -> Float[Array, "*batch d"]:
        """The action so far up in each dimension of the indexed cell."""
        return self.axes.within(self.axes.encode(self.decode(index)), share)


def stacked(rows: Sequence[Float[Array, "*batch _"]], k: int, filling: float) -> Float[Array, "*batch d k"]:
    """One row for each of d dimensions, those that are shorter than k filled up behind."""
    widths = [[(0, 0)] * (row.ndim - 1) + [(0, k - row.shape[-1])] for row in rows]
    return jnp.stack(
        [jnp.pad(row, width, constant_values=filling) for row, width in zip(rows, widths, strict=True)], -2
    )


def mu_law(low: float, high: float, n_bins: int, mu: float = MU) -> Float[np.ndarray, " k"]:
    """The centers of bins that lie closer together towards the middle of the box; the first and last are its bounds.

    With x from −1 to 1 in equal steps they are sgn(x) ((1 + μ)^|x| − 1) / μ in half-widths from the middle: what is
    near the middle is told apart 1 + μ times as finely as what is near a bound.
    """
    x = np.linspace(-1, 1, n_bins)
    placed: np.ndarray = (high + low) / 2 + (high - low) / 2 * np.sign(x) * np.expm1(np.abs(x) * np.log1p(mu)) / mu
    placed[[0, -1]] = low, high
    return placed


class PlacedBins(Bins):
    """The bins of one dimension whose centers are given; the edges lie half-way between them.

    Their width is the mean one, so that an HL-Gauss target's σ = η · width is in the action's own units, the same
    wherever the action is.

    Args:
        low: the box's lower bound.
        high: its upper bound.
        centers: two or more, from the lowest to the highest, none beyond the bounds.

    Raises:
        UsageError: centers that are not so.
    """

    def __init__(self, low: float, high: float, centers: Sequence[float] | np.ndarray) -> None:
        placed = as_numbers("bin_centers", centers)
        told = f"bin_centers is {centers!r}"
        require(placed.ndim == 1 and placed.size > 1, f"{told}; give two numbers or more")
        kept = placed.astype(jax.dtypes.canonicalize_dtype(np.float64))
        require(bool((np.diff(kept) > 0).all()), f"{told}; each must lie above the one before it")
        require(
            bool(low <= kept[0] and kept[-1] <= high), f"{told}; they must lie within the bounds, {low:g} and {high:g}"
        )
        super().__init__(low, high, len(placed))
        middles = (placed[1:] + placed[:-1]) / 2
        edges = np.concatenate([self.low, middles, self.high])[None]
        own = {"edges": edges, "centers": kept[None], "edges_rest": edges - edges.astype(kept.dtype)}
        vars(self).update({name: value.astype(kept.dtype) for name, value in own.items()})

    def encode(self, action: Float[Array, "*batch d"]) -> Int[Array, "*batch d"]:
        """The index of the bin that holds each entry of an action: the number of inner edges at or below it."""
        return (action[..., None] >= jnp.asarray(self.edges[:, 1:-1])).sum(-1)


class UnevenBins(Bins):
    """The bins of dimensions that do not look alike: numbers that are cut into bins, beside choices.

    A choice among n values has a bin for each, whose center is the value: low, low + 1, …, low + n − 1. All arrays are
    padded to k, the largest number of bins; the padding is no bin, and `valid` tells.

    Args:
        dimensions: the bins of each dimension, one dimension in each; or of a choice the first value and their number.
        ordered: the places of those that are choices all the same: their values have an order, as bins have.
        etas: the width of each dimension's HL-Gauss target, NaN where it is the loss's; None where it is everywhere.
    """

    sizes: tuple[int, ...]
    """The number of bins in each dimension."""
    valid: Bool[np.ndarray, "d k"]
    """True for places in the arrays that are bins, False for padding."""
    is_choice: Bool[np.ndarray, " d"]
    """True for dimensions that are choices, whether or not their values have an order."""
    dimensions: tuple[Bins | tuple[float, int], ...]
    """As they were given."""
    etas: Float[np.ndarray, " d"] | None
    """As they were given."""

    def __init__(
        self,
        dimensions: Sequence[Bins | tuple[float, int]],
        ordered: Sequence[int] = (),
        etas: Float[np.ndarray, " d"] | None = None,
    ) -> None:
        dtype = jax.dtypes.canonicalize_dtype(np.float64)
        sizes = tuple(part.n_bins if isinstance(part, Bins) else part[1] for part in dimensions)
        k, d = max(sizes), len(sizes)
        low, high, width, centers, edges = np.zeros(d), np.zeros(d), np.ones(d), np.zeros((d, k)), np.zeros((d, k + 1))
        edges[:, 1:] = np.inf  # nothing is beyond the last bin
        for i, part in enumerate(dimensions):
            row = part.centers[0] if isinstance(part, Bins) else part[0] + np.arange(part[1])
            low[i], high[i] = (part.low[0], part.high[0]) if isinstance(part, Bins) else (row[0], row[-1])
            width[i] = part.width[0] if isinstance(part, Bins) else 1.0
            edges[i, 0] = low[i]
            edges[i, 1 : len(row)] = part.edges[0, 1:-1] if isinstance(part, Bins) else row[1:] - 0.5
            centers[i] = np.pad(row, (0, k - len(row)), "edge")
        arrays = {"low": low, "high": high, "edges": edges, "centers": centers, "width": width}
        own: dict[str, Any] = {name: value.astype(dtype) for name, value in arrays.items()}
        own |= {"edges_rest": np.zeros_like(own["edges"]), "n_bins": k, "bin_centers": "inside", "sizes": sizes}
        own["valid"] = np.arange(k) < np.array(sizes)[:, None]
        own["is_choice"] = np.array([not isinstance(part, Bins) or i in ordered for i, part in enumerate(dimensions)])
        vars(self).update(own | {"dimensions": tuple(dimensions), "etas": etas})

    encode = PlacedBins.encode

    def at_edge(self, action: Float[Array, "*batch d"]) -> Bool[Array, "*batch d"]:
        """Return True for entries in the first or last bin of a number, or beyond."""
        last = self.edges[np.arange(len(self.sizes)), np.array(self.sizes) - 1]
        return ((action < self.edges[:, 1]) | (action >= last)) & ~self.is_choice
