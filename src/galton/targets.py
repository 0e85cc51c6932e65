"""From a continuous action to the histogram that a softmax policy is trained towards (§2.3, §4.2)."""

from typing import Literal

import jax
import jax.numpy as jnp
from jax import lax
from jax.scipy.special import erf
from jaxtyping import Array, Float, Int

from galton.bins import Bins
from galton.errors import require

Eta = float | int | Float[Array, ""]
Tails = Literal["rescaled", "edges"]
Centers = Literal["inside", "bounds"]

_SQRT2 = 2**0.5


def one_hot(bins: Bins, action: Float[Array, "*batch d"]) -> Float[Array, "*batch d k"]:
    """All mass on the bin that holds the action: q_a(i) = [a in bin i]."""
    return jax.nn.one_hot(bins.encode(action), bins.n_bins, dtype=action.dtype)


def two_hot(bins: Bins, value: Float[Array, "*batch d"]) -> Float[Array, "*batch d k"]:
    """The histogram whose mean is the value: the two centers around it share the mass by their distance.

    The weight of a center is 1 less its distance in widths, and at least 0. A value beyond the first or the last center
    counts as that center.
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

    Args:
        bins: k bins in each of d dimensions.
        action: any real values.
        eta: η > 0, the standard deviation in bin widths.
        tails: what becomes of the mass beyond the box.
    """
    _check(eta)
    # The difference to an edge nearby is exact in floating point; then add what rounding took from the edge.
    distance = (bins.edges - bins.clip(action)[..., None]) + bins.edges_rest
    cdf = erf(distance / (eta * _SQRT2 * bins.width[:, None]))
    if tails == "edges":
        return 0.5 * jnp.maximum(jnp.diff(cdf.at[..., 0].set(-1.0).at[..., -1].set(1.0)), 0.0)
    mass = jnp.maximum(jnp.diff(cdf), 0.0)  # rounding makes erf fall by an ulp here and there
    return mass / mass.sum(-1, keepdims=True)


def hl_gauss_of_center(
    n_bins: int, index: Int[Array, "*batch"], eta: Eta, tails: Tails = "rescaled", centers: Centers = "inside"
) -> Float[Array, "*batch k"]:
    """`hl_gauss` where the action is the center of bin `index`, at a fraction of the work.

    In bin widths all centers see the same Gaussian: every target is a window of one vector of 2k − 1 bin
    masses, rescaled. Where the bins at the ends are cut off elsewhere, or not at all, their two masses are put in.
    """
    _check(eta)
    scale = eta * _SQRT2
    cdf = erf((jnp.arange(2 * n_bins, dtype=float) - (n_bins - 0.5)) / scale)
    mass = jnp.maximum(jnp.diff(cdf), 0.0)
    start = (n_bins - 1) - index
    low, high = cdf[start], cdf[start + n_bins]
    window = jnp.vectorize(lambda i: lax.dynamic_slice(mass, (i,), (n_bins,)), signature="()->(k)")
    target: Array = window(start)
    if (tails, centers) != ("rescaled", "inside"):
        low, high = erf(-index / scale), erf((n_bins - 1 - index) / scale)  # from center to center
        if tails == "edges":
            low, high = -jnp.ones_like(low), jnp.ones_like(high)
        ends = (jnp.maximum(end, 0.0) for end in (cdf[start + 1] - low, high - cdf[start + n_bins - 1]))
        target = target.at[..., 0].set(next(ends)).at[..., -1].set(next(ends))
    return target / (high - low)[..., None]


def _check(eta: Eta) -> None:
    if isinstance(eta, (int, float)):
        require(eta > 0, f"eta is {eta}; the target's width must be greater than 0")
