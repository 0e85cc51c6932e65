"""HL-Gauss's targets of a histogram's actions, and their mean under it, Kᵀπ, by the kind of its bins."""

import functools
from collections.abc import Callable

import jax.numpy as jnp
from jax.nn import one_hot
from jaxtyping import Array, Float, Int

from galton import targets
from galton.bins import Bins, GridBins, PlacedBins, UnevenBins, stacked
from galton.policies.histogram import Histogram
from galton.targets import Eta, Tails

Weights = Float[Array, "*batch softmaxes k"]
"""Of the bins' log π; over the cells of a grid `[*batch, 1, k^d]`."""
TINY = 1e-30
"""Nothing is divided by less."""


@functools.singledispatch
def of_action(bins: Bins, own: Histogram, action: Float[Array, "*batch d"], eta: Eta, tails: Tails) -> Weights:
    """A Gaussian histogram of σ = η bin widths around each action, or its bin's center where centers are sampled."""
    if own.choices.is_masked:
        return _of_each_action(bins, own, action, eta, tails)
    if own.samples_centers:
        return targets.hl_gauss_of_center(bins.n_bins, bins.encode(action), eta, tails, bins.bin_centers)
    return targets.hl_gauss(bins, action, eta, tails)


@functools.singledispatch
def expected(bins: Bins, own: Histogram, eta: Eta, tails: Tails) -> Weights:
    """Kᵀπ, the mean of the targets over the histogram's own actions at centers; row j of K is the target of bin j's."""
    if own.choices.is_masked:
        return _each_expected(bins, own, eta, tails)
    return targets.mean_of_centers(own.probs, eta, tails, bins.bin_centers)


@of_action.register(GridBins)
def _(
    bins: GridBins, own: Histogram, action: Float[Array, "*batch d"], eta: Eta, tails: Tails
) -> Float[Array, "*batch 1 cells"]:
    """The product of the dimensions' targets."""
    rows = of_action(bins.axes, own, action, eta, tails)
    cells = rows[..., 0, :]
    for i in range(1, rows.shape[-2]):
        cells = (cells[..., None] * rows[..., i, None, :]).reshape(*rows.shape[:-2], -1)
    return cells[..., None, :]


@expected.register(GridBins)
def _(bins: GridBins, own: Histogram, eta: Eta, tails: Tails) -> Float[Array, "*batch 1 cells"]:
    """Each dimension's K along its axis."""
    d, k = bins.axes.centers.shape
    cells, shape = own.probs.reshape(*own.probs.shape[:-2], *[k] * d), own.probs.shape
    for i in range(d):
        width = eta[..., i].reshape(*shape[:-2], *[1] * (d - 1)) if isinstance(eta, Array) and eta.ndim else eta
        along = jnp.moveaxis(cells, i - d, -1)
        cells = jnp.moveaxis(targets.mean_of_centers(along, width, tails, bins.bin_centers), -1, i - d)
    return cells.reshape(shape)


@of_action.register(UnevenBins)
def _of_each_action(bins: Bins, own: Histogram, action: Float[Array, "*batch d"], eta: Eta, tails: Tails) -> Weights:
    """The target of each dimension by itself: of a choice all mass on its value."""
    index: Int[Array, "*batch d"] = bins.encode(action)

    def of_number(bins: Bins, i: int, eta: Eta) -> Array:
        return targets.of_bin(bins, index[..., i], eta, tails)

    whole = _each(bins, eta, of_number, lambda n, i: one_hot(index[..., i], n))
    if not own.choices.is_masked:
        return whole
    inside = jnp.where(own.allowed, whole, 0.0)
    return inside / jnp.maximum(inside.sum(-1, keepdims=True), TINY)


@expected.register(UnevenBins)
def _each_expected(bins: Bins, own: Histogram, eta: Eta, tails: Tails) -> Weights:
    """Kᵀπ of each dimension by itself: of a choice π. Where bins are masked, a row of K is what is left of it."""
    probs, allowed = own.probs, own.allowed.astype(own.logits.dtype)

    def of_number(bins: Bins, i: int, eta: Eta) -> Array:
        k = bins.n_bins
        here, left_over = probs[..., i, :k], allowed[..., i, :k]
        if not own.choices.is_masked and not isinstance(bins, PlacedBins):
            return targets.mean_of_centers(here, eta, tails, bins.bin_centers)
        index, every = jnp.arange(k), eta
        if isinstance(eta, Array) and eta.ndim:
            index, every = (jnp.broadcast_to(x, (*eta.shape, k)) for x in (index, eta[..., None]))
        kernel = targets.of_bin(bins, index, every, tails)
        left = jnp.maximum(jnp.einsum("...jk,...k->...j", kernel, left_over), TINY)
        return jnp.einsum("...j,...jk->...k", here / left, kernel) * left_over

    return _each(bins, eta, of_number, lambda n, i: probs[..., i, :n])


def _each(
    bins: Bins, eta: Eta, of_number: Callable[[Bins, int, Eta], Array], of_choice: Callable[[int, int], Array]
) -> Weights:
    parts = bins.dimensions if isinstance(bins, UnevenBins) else (bins,) * len(bins.low)
    widths = jnp.moveaxis(eta, -1, 0) if isinstance(eta, Array) and eta.ndim else (eta,) * len(parts)
    found = [
        of_choice(part[1], i) if isinstance(part, tuple) else of_number(part, i, widths[i])
        for i, part in enumerate(parts)
    ]
    return stacked(found, bins.n_bins, 0.0)
