"""From a continuous action to the histogram that a softmax policy is trained towards (§2.3, §4.2)."""

import math
from typing import Any, Literal, get_args

import jax
import jax.numpy as jnp
from jax import lax
from jax.scipy.special import erf
from jaxtyping import Array, Float, Int

from galton.bins import Bins, Centers, PlacedBins
from galton.errors import require, require_word

Eta = float | int | Float[Array, "*entries"]
"""HL-Gauss's width, one for all or one for each entry of the actions."""
Tails = Literal["rescaled", "edges", "reflected"]

_SQRT2 = 2**0.5
FEW = 256
"""Up to so many bins a reflected K is a matrix. Which is faster depends on the rows too: for a few hundred of them
Fourier transforms are from here on, for thousands the matrix is."""


def one_hot(bins: Bins, action: Float[Array, "*batch d"]) -> Float[Array, "*batch softmaxes k"]:
    """All mass on the bin that holds the action: q_a(i) = [a in bin i]."""
    return jax.nn.one_hot(bins.encode(action), bins.n_bins, dtype=action.dtype)


def two_hot(bins: Bins, value: Float[Array, "*batch d"]) -> Float[Array, "*batch d k"]:
    """The histogram whose mean is the value: the two centers around it share the mass by their distance.

    Centers are equally far apart. The weight of one is 1 less its distance in widths, and at least 0. A value beyond
    the first or the last center counts as that center.
    """
    within = jnp.clip(value, bins.centers[:, 0], bins.centers[:, -1])
    return jnp.maximum(1 - jnp.abs(bins.centers - within[..., None]) / bins.width[:, None], 0.0)


def hl_gauss(
    bins: Bins, action: Float[Array, "*batch d"], eta: Eta, tails: Tails = "rescaled"
) -> Float[Array, "*batch d k"]:
    """The histogram of a Gaussian around the action, cut off at the box and rescaled to sum to one.

    q_a(i) = (Φ((e_{i+1} − a)/σ) − Φ((e_i − a)/σ)) / (Φ((high − a)/σ) − Φ((low − a)/σ)) with σ = η · width, the
    bin edges e and the action a clipped into the box, so that the mass inside is never less than about a half
    or, for a wide Gaussian, than its share of the box.

    With tails="edges" nothing is rescaled: the first bin gets all that lies below its upper edge, the last all that
    lies above its lower one. It is the histogram of the Gaussian's values clipped into the box.

    With tails="reflected" what lies beyond the outermost bins is folded back into them, as often as it takes, and bins
    count as equally wide: q_a(i) = Σ_m φ(i − x + 2km) + φ(i + x + 1 + 2km) with the mass φ of a bin of width 1 under a
    Gaussian of σ = η, and the action x in bin widths from the first center. The targets of the centers are then a
    matrix K that is symmetric, positive semidefinite and doubly stochastic. Bins that were placed keep their widths:
    what lies beyond a bound is folded back there.

    Args:
        bins: k bins in each of d dimensions.
        action: any real values.
        eta: η > 0, the standard deviation in bin widths, one for all or `[*batch, d]`.
        tails: what becomes of the mass beyond the box.
    """
    _check(eta, tails)
    if tails == "reflected" and isinstance(bins, PlacedBins):
        return _mirrored(bins, bins.clip(action), eta)
    if tails == "reflected":
        place = (bins.clip(action) - bins.centers[:, 0]) / bins.width
        steps = jnp.arange(bins.n_bins)
        there, back = steps - place[..., None], steps + place[..., None] + 1
        return _folded(bins.n_bins, there, eta) + _folded(bins.n_bins, back, eta)
    # The difference to an edge nearby is exact in floating point; then add what rounding took from the edge.
    distance = (bins.edges - bins.clip(action)[..., None]) + bins.edges_rest
    cdf = erf(distance / (_column(eta) * _SQRT2 * bins.width[:, None]))
    if tails == "edges":
        return 0.5 * jnp.maximum(jnp.diff(cdf.at[..., 0].set(-1.0).at[..., -1].set(1.0)), 0.0)
    mass = jnp.maximum(jnp.diff(cdf), 0.0)  # rounding makes erf fall by an ulp here and there
    return mass / mass.sum(-1, keepdims=True)


def of_bin(bins: Bins, index: Int[Array, "*batch"], eta: Eta, tails: Tails) -> Float[Array, "*batch k"]:
    """`hl_gauss` where the action is the center of bin `index`, of one dimension's bins of any kind."""
    if not isinstance(bins, PlacedBins):
        return hl_gauss_of_center(bins.n_bins, index, eta, tails, bins.bin_centers)
    action = jnp.asarray(bins.centers[0])[index][..., None]
    return hl_gauss(bins, action, _column(eta), tails)[..., 0, :]


def hl_gauss_of_center(
    n_bins: int, index: Int[Array, "*batch"], eta: Eta, tails: Tails = "rescaled", centers: Centers = "inside"
) -> Float[Array, "*batch k"]:
    """`hl_gauss` where the action is the center of bin `index`, at a fraction of the work.

    In bin widths all centers see the same Gaussian: with one η for all every target is a window of one vector of
    2k − 1 bin masses, rescaled. Where the bins at the ends are cut off elsewhere, or not at all, their two masses are
    put in. With an η for each index the masses of its own k bins are computed. A reflected target is two windows of
    one vector of 2k folded masses.
    """
    _check(eta, tails, centers)
    if tails == "reflected":
        steps = jnp.arange(n_bins)
        if jnp.ndim(eta):
            there, back = steps - index[..., None], steps + index[..., None] + 1
            return _folded(n_bins, there, eta) + _folded(n_bins, back, eta)
        folded = _folded(n_bins, jnp.arange(2 * n_bins), eta)
        both_ways = jnp.concatenate([folded[n_bins - 1 : 0 : -1], folded])
        return _windows(both_ways, n_bins - 1 - index, n_bins) + _windows(folded, index + 1, n_bins)
    if jnp.ndim(eta):
        low, high = _ends(n_bins, index, eta, tails, centers)
        inner = erf((jnp.arange(1, n_bins) - (index + 0.5)[..., None]) / (_column(eta) * _SQRT2))
        cdf = jnp.concatenate([low[..., None], inner, high[..., None]], -1)
        return jnp.maximum(jnp.diff(cdf), 0.0) / (high - low)[..., None]
    mass, cdf = _masses(n_bins, eta)
    start = (n_bins - 1) - index
    low, high = cdf[start], cdf[start + n_bins]
    target = _windows(mass, start, n_bins)
    if (tails, centers) != ("rescaled", "inside"):
        low, high = _ends(n_bins, index, eta, tails, centers)
        ends = (jnp.maximum(end, 0.0) for end in (cdf[start + 1] - low, high - cdf[start + n_bins - 1]))
        target = target.at[..., 0].set(next(ends)).at[..., -1].set(next(ends))
    return target / (high - low)[..., None]


def mean_of_centers(
    probs: Float[Array, "*batch k"], eta: Eta, tails: Tails = "rescaled", centers: Centers = "inside"
) -> Float[Array, "*batch k"]:
    """Kᵀπ, the mean of `hl_gauss_of_center` over bins drawn from these probabilities π.

    Row j of K is the target of bin j's center. With one η for all, K is one matrix. Otherwise each entry has a K of its
    own, which is never made: but for the scales of its rows, and the bins at its ends, it is a Toeplitz matrix of
    2k − 1 masses. So Kᵀπ is their convolution with the scaled π, by Fourier transforms, exact up to rounding. The
    reflected K is a convolution of π and its mirror image, and a matrix product where bins are few.
    """
    _check(eta, tails, centers)
    k = probs.shape[-1]
    index = jnp.arange(k)
    if tails == "reflected" and (jnp.ndim(eta) or k > FEW):
        mirrored = jnp.concatenate([probs, probs[..., ::-1]], -1)
        spectrum = jnp.fft.rfft(mirrored) * jnp.fft.rfft(_folded(k, jnp.arange(2 * k), eta)).real
        return jnp.maximum(jnp.fft.irfft(spectrum, 2 * k)[..., :k], 0.0)
    if not jnp.ndim(eta):
        return probs @ hl_gauss_of_center(k, index, eta, tails, centers)
    mass, cdf = _masses(k, eta)
    low, high = _ends(k, index, _column(eta), tails, centers)
    scaled = probs / (high - low)
    spectrum = jnp.fft.rfft(scaled, 2 * k) * jnp.fft.rfft(mass, 2 * k)
    inner = jnp.fft.irfft(spectrum, 2 * k)[..., k : 2 * k - 2]
    # How the centers, from the first to the last, see the inner edges of the bins at the ends: 1 − ½ − j, k − 1½ − j.
    first = (scaled * (cdf[..., k:0:-1] - low)).sum(-1, keepdims=True)
    last = (scaled * (high - cdf[..., 2 * k - 2 : k - 2 : -1])).sum(-1, keepdims=True)
    return jnp.concatenate([first, inner, last], -1)


def _windows(masses: Float[Array, " m"], start: Int[Array, "*batch"], size: int) -> Float[Array, "*batch k"]:
    """So many masses from each of these places on."""
    window = jnp.vectorize(lambda i: lax.dynamic_slice(masses, (i,), (size,)), signature="()->(k)")
    found: Array = window(start)
    return found


def _folded(
    n_bins: int, step: Float[Array, "*#batch n"] | Int[Array, "*#batch n"], eta: Eta
) -> Float[Array, "*batch n"]:
    """Σ_m φ(step + 2km), the mass of a bin so many steps away under a Gaussian of σ = η that comes round after 2k bins.

    Up to η = k/3 three rounds are all that float64 can tell, and from there on eight waves of its Fourier series.
    """
    period, width = 2 * n_bins, _column(eta)
    step = (step + n_bins) % period - n_bins
    scale = jnp.minimum(width, n_bins / 3) * _SQRT2
    mass = sum(erf((step + 0.5 + m * period) / scale) - erf((step - 0.5 + m * period) / scale) for m in (-1, 0, 1))
    wide, cosine = jnp.full_like(mass, 0.5), jnp.cos(math.pi / n_bins * step)
    before, wave = jnp.ones_like(cosine), cosine
    for n in range(1, 9):  # cos(n x) = 2 cos(x) cos((n − 1) x) − cos((n − 2) x)
        angle = math.pi * n / n_bins
        of_bin = math.sin(angle / 2) / (angle / 2)  # a bin's mass is an average over its width
        wide = wide + of_bin * jnp.exp(-0.5 * (angle * width) ** 2) * wave
        before, wave = wave, 2 * cosine * wave - before
    return jnp.where(width > n_bins / 3, wide / n_bins, jnp.maximum(mass, 0.0) / 2)


def _mirrored(bins: Bins, action: Float[Array, "*batch d"], eta: Eta) -> Float[Array, "*batch d k"]:
    """The mass of a Gaussian around the action and around its mirror images behind the bounds, five rounds of them."""
    from_low, span = (action - bins.low)[..., None], (bins.high - bins.low)[:, None]
    edges, scale = bins.edges - bins.low[:, None], _column(eta) * _SQRT2 * bins.width[:, None]
    images = (2 * m * span + side * from_low for m in range(-2, 3) for side in (-1, 1))
    folded = jnp.maximum(sum(jnp.diff(erf((edges - image) / scale)) for image in images), 0.0)
    return folded / folded.sum(-1, keepdims=True)


def _masses(n_bins: int, eta: Eta) -> tuple[Float[Array, "*entries m"], Float[Array, "*entries m+1"]]:
    """The masses of the 2k − 1 bins around a center, both ways as far as there can be bins, and erf at their edges."""
    scale = _column(eta) * _SQRT2
    cdf = erf((jnp.arange(2 * n_bins, dtype=float) - (n_bins - 0.5)) / scale)
    return jnp.maximum(jnp.diff(cdf), 0.0), cdf


def _ends(
    n_bins: int, index: Int[Array, "*batch"], eta: Any, tails: Tails, centers: Centers
) -> tuple[Float[Array, "*entries"], Float[Array, "*entries"]]:
    """Return erf at the ends of each center's target, below and above; −1 and 1 where the target keeps its tails."""
    if tails == "edges":
        whole = jnp.ones(jnp.broadcast_shapes(jnp.shape(index), jnp.shape(eta)))
        return -whole, whole
    scale, beyond = eta * _SQRT2, 0.5 if centers == "inside" else 0.0
    return erf(-(index + beyond) / scale), erf((n_bins - 1 - index + beyond) / scale)


def _column(eta: Eta) -> Eta | Float[Array, "*entries 1"]:
    """η with an axis of bins behind its own, if it has any."""
    return jnp.asarray(eta)[..., None] if jnp.ndim(eta) else eta


def _check(eta: Eta, tails: str, centers: str = "inside") -> None:
    require_word("tails", tails, get_args(Tails))
    require_word("centers", centers, get_args(Centers))
    if isinstance(eta, (int, float)):
        require(eta > 0, f"eta is {eta}; the target's width must be greater than 0")
