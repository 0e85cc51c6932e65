"""The normal distribution beside an edge, in float32: tails and pieces of it, with their moments and gradients.

All is an integral from an edge outwards, ∫₀ʷ tⁿ exp(−ζ t − t²/2) dt, where ζ ≥ 0 says how far behind the edge the mean
lies and w how far the piece reaches, both in σ. Nothing large is subtracted from anything large, so that a mean far
outside the box has the right gradient too, where Φ(β) − Φ(α) would be 0. The integral is Gauss and Legendre's with 16
nodes over what reaches down to e⁻²⁰ of the first value: to float32's rounding it is exact.
"""

import math
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax.scipy.special import erfc
from jaxtyping import Array, Float

LOG_SQRT_2PI = 0.5 * math.log(2 * math.pi)
FAR = 1e9
"""Further than so many σ nothing is told apart: powers of it are finite in float32."""
LEAST = 1e-36
"""The floor under a variance, so that the gradient of its root is finite."""
_DROP = 20.0
_NODES, _WEIGHTS = (np.asarray(x) for x in np.polynomial.legendre.leggauss(16))


class Piece(NamedTuple):
    """∫₀ʷ tⁿ exp(−ζ t − t²/2) dt for n = 0, 1, 2."""

    mass: Float[Array, "*batch"]
    """The integral for n = 0; times φ(ζ) it is the probability of the piece."""
    first: Float[Array, "*batch"]
    second: Float[Array, "*batch"]


def piece(zeta: Float[Array, "*#batch"], width: Float[Array, "*#batch"] | float = math.inf) -> Piece:
    """The piece from an edge ζ ≥ 0 behind which the mean lies, up to `width` ≥ 0 beyond the edge; both in σ."""
    return _piece(*jnp.broadcast_arrays(jnp.minimum(zeta, FAR), jnp.asarray(width, zeta.dtype)))


@jax.custom_jvp
def _piece(zeta: Float[Array, "*batch"], width: Float[Array, "*batch"]) -> Piece:
    return Piece(*_moments(zeta, width, 2)[:-1])


@_piece.defjvp
def _(primals: tuple[Array, Array], tangents: tuple[Array, Array]) -> tuple[Piece, Piece]:
    """d/dζ of a moment is the next one, negated; d/dw is the integrand at the end."""
    (zeta, width), (zeta_dot, width_dot) = primals, tangents
    *moments, length = _moments(zeta, width, 3)
    end = jnp.where(length < width, 0.0, jnp.exp(-zeta * length - 0.5 * length**2)) * width_dot
    slopes = [end * length**n - moments[n + 1] * zeta_dot for n in range(3)]
    return Piece(*moments[:3]), Piece(*slopes)


def _moments(zeta: Float[Array, "*batch"], width: Float[Array, "*batch"], highest: int) -> list[Float[Array, "*batch"]]:
    """The integrals for n from 0 to the highest, and how far out they go."""
    reach = 2 * _DROP / (zeta + jnp.sqrt(zeta**2 + 2 * _DROP))
    length = jnp.minimum(width, reach)
    t = length[..., None] * (0.5 + 0.5 * _NODES).astype(zeta.dtype)
    share = length[..., None] * (0.5 * _WEIGHTS).astype(zeta.dtype) * jnp.exp(-zeta[..., None] * t - 0.5 * t**2)
    return [(share * t**n).sum(-1) for n in range(highest + 1)] + [length]


def log_tail(x: Float[Array, "*batch"]) -> Float[Array, "*batch"]:
    """log(1 − Φ(x)), with a gradient that is right however large x is."""
    above = jnp.where(x > 0, jnp.minimum(x, FAR), 0.0)
    far = -0.5 * above**2 - LOG_SQRT_2PI + jnp.log(piece(above).mass)
    near = jnp.log1p(-0.5 * erfc(jnp.where(x > 0, 0.0, -jnp.maximum(x, -FAR)) / math.sqrt(2)))
    return jnp.where(x > 0, far, near)


class Inside(NamedTuple):
    """The part of N(mean, std²) in an interval, seen from the point of the interval that is nearest to the mean."""

    edge: Float[Array, "*batch"]
    """That point: the mean itself where it is inside."""
    zeta: Float[Array, "*batch"]
    """The distance of that point from the mean, in σ."""
    below: Piece
    """From the point down to the interval's lower end."""
    above: Piece
    """From the point up to the interval's upper end."""

    @property
    def log_mass(self) -> Float[Array, "*batch"]:
        """log(Φ((high − mean) / σ) − Φ((low − mean) / σ)) less log φ(ζ)."""
        return jnp.log(self.below.mass + self.above.mass)


def inside(
    mean: Float[Array, "*batch"],
    std: Float[Array, "*of_batch"],
    low: Float[Array | np.ndarray, "*ends"],
    high: Float[Array | np.ndarray, "*ends"],
) -> Inside:
    """Measure N(mean, std²) in [low, high]; what has fewer axes than the mean is the same along its first ones."""
    edge = jnp.where(mean < low, low, jnp.where(mean > high, high, mean))  # on a bound clip has half the slope
    zeta = jnp.minimum(jnp.abs(mean - edge) / std, FAR)
    return Inside(edge, zeta, piece(zeta, (edge - low) / std), piece(zeta, -(edge - high) / std))


def quantile(
    zeta: Float[Array, "*#batch"], width: Float[Array, "*#batch"], share: Float[Array, "*#batch"]
) -> Float[Array, "*batch"]:
    """Return the distance beyond the edge, in σ, at which that share in [0, 1] of a piece's mass is reached.

    Newton's method on the logarithm of what is left beyond t, which is concave: from the right it never overshoots.
    Near the edge, where that rounds, it is followed by a step on the mass itself. What rounds to all of a tail without
    an end counts as the last number below that.
    """
    zeta = jnp.minimum(zeta, FAR)
    whole, wanted = piece(zeta).mass, share * piece(zeta, width).mass
    drop = -jnp.log1p(-jnp.minimum(wanted / whole, 1 - np.finfo(wanted.dtype).epsneg))
    t = 2 * drop / jnp.maximum(zeta + jnp.sqrt(zeta**2 + 2 * drop), 1e-30)
    for _ in range(4):
        rest = piece(zeta + t).mass
        t += (drop - zeta * t - 0.5 * t**2 + jnp.log(rest / whole)) * rest
    t = jnp.maximum(t, 0.0)
    near = t - (piece(zeta, t).mass - wanted) * jnp.exp(zeta * t + 0.5 * t**2)
    return jnp.clip(jnp.where(drop < 0.5, near, t), 0.0, width)
