"""A smooth density of any shape on the box: its logarithm is a cubic spline of the action, on a fine grid."""

import dataclasses
import functools
from typing import Annotated, ClassVar, Literal

import jax
import jax.numpy as jnp
import numpy as np
from jax.nn import log_softmax, logsumexp
from jaxtyping import Array, Float, Key

from galton.fields import AtLeast
from galton.policies.base import Marginal, Policy, near_edge
from galton.policies.gaussian import Units, units_of
from galton.policies.histogram import sample_bin
from galton.types import Finite, Params

CELLS = 64
"""Cells of the grid on which the density is linear, of one width."""
_NODES = np.arange(CELLS + 1)
_INNER = (_NODES > 0) & (_NODES < CELLS)
LOG_WEIGHT = np.where(_INNER, 0.0, -np.log(2.0))
"""log ∫ hat: a hat function is 1 at its node and 0 at the others; those at the ends are cut in half."""
MEANS = np.clip(_NODES, 1 / 3, CELLS - 1 / 3)
"""The mean of each hat as a density, in cells from the lower bound."""
_SERIES = np.array([*(1 / ((2 * k - 1) * 2 * k * (2 * k + 1)) for k in range(6, 0, -1)), 0.0])
_VARIANCES = np.where(_INNER, 1 / 6, 1 / 18)


@dataclasses.dataclass(frozen=True)
class Spline:
    """A density that is linear between the nodes of a grid, in each dimension: a mixture of hat functions.

    All that it says of itself is of this density, so that actions are drawn from what `log_prob` tells.
    """

    coefficients: Float[Array, "*batch d n"]
    """The coefficients of the B-splines that add up to the log-density at the nodes, up to a constant."""
    low: Float[np.ndarray, " d"]
    high: Float[np.ndarray, " d"]
    rule: Literal["mode", "mean"] = "mode"

    @property
    def logits(self) -> Float[Array, "*batch d nodes"]:
        """The logarithm of the density at each node, up to a constant."""
        return self.coefficients @ self._basis().T

    def sample(self, noise: Float[Array, "*batch n"]) -> Float[Array, "*batch d"]:
        """A hat by the first d numbers, and a place under it by the others."""
        chosen, place = jnp.split(noise, 2, -1)
        node = sample_bin(self._shares(), chosen)
        offset = jnp.where(place < 0.5, jnp.sqrt(2 * place) - 1, 1 - jnp.sqrt(2 - 2 * place))
        offset = jnp.where(node == 0, jnp.abs(offset), jnp.where(node == CELLS, -jnp.abs(offset), offset))
        return self._at(node + offset)

    def log_prob(self, action: Float[Array, "*batch d"]) -> Float[Array, "*batch"]:
        """Σ_l log Σ_i hat_i(a_l) exp(logit_i) − log Z_l; an action beyond a bound counts as the bound."""
        x = jnp.clip((action - self.low) / (self.high - self.low), 0.0, 1.0) * CELLS
        cell = jnp.minimum(x.astype(int), CELLS - 1)
        there = jnp.stack([(self.coefficients * self._basis()[cell + i]).sum(-1) for i in (0, 1)], -1)
        hats = jnp.stack([cell + 1 - x, x - cell], -1)
        return (logsumexp(there, axis=-1, b=hats) - self._log_z()).sum(-1)

    def entropy(self) -> Float[Array, "*batch"]:
        """−Σ_l ∫ π log π, where E log π in a cell in which π goes from (1 − x) m to (1 + x) m is log m + c(x).

        c(x) = Σ_k x²ᵏ / (2k − 1) 2k (2k + 1). With six terms that is float32's rounding where the density changes less
        than fourfold from node to node, and else at most 0.0015 off.
        """
        density = jnp.exp(self.logits - self._log_z()[..., None])
        below, above = density[..., :-1], density[..., 1:]
        mean = (below + above) / 2
        safe = jnp.maximum(mean, 1e-18)  # what is less adds nothing, and the square is a number
        inside = mean * (jnp.log(safe) + jnp.polyval(_SERIES.astype(mean.dtype), ((above - below) / (2 * safe)) ** 2))
        return -(inside.sum(-1) * (self.high - self.low) / CELLS).sum(-1)

    def mean(self) -> Float[Array, "*batch d"]:
        """The mean of the action."""
        return self._at((jax.nn.softmax(self._shares()) * MEANS).sum(-1))

    def std(self) -> Float[Array, "*batch d"]:
        """The standard deviation of the action."""
        shares = jax.nn.softmax(self._shares())
        apart = MEANS.astype(shares.dtype) - (shares * MEANS).sum(-1, keepdims=True)
        return jnp.sqrt((shares * (apart**2 + _VARIANCES)).sum(-1)) * (self.high - self.low) / CELLS

    at_edge = near_edge

    def deterministic_action(self) -> Float[Array, "*batch d"]:
        """The node where the density is largest, or the mean."""
        if self.rule == "mean":
            return self.mean()
        return jnp.asarray(nodes(self.low, self.high))[jnp.arange(len(self.low)), self.logits.argmax(-1)]

    def _at(self, x: Float[Array, "*batch d"]) -> Float[Array, "*batch d"]:
        """The action so many cells above the lower bound."""
        return jnp.clip(self.low + (self.high - self.low) / CELLS * x, self.low, self.high)

    def _basis(self) -> Float[Array, "nodes n"]:
        return jnp.asarray(basis(self.coefficients.shape[-1]), self.coefficients.dtype)

    def _shares(self) -> Float[Array, "*batch d nodes"]:
        """The logarithm of each hat's probability."""
        return log_softmax(self.logits + LOG_WEIGHT.astype(self.logits.dtype))

    def _log_z(self) -> Float[Array, "*batch d"]:
        log_masses = self.logits + LOG_WEIGHT.astype(self.logits.dtype)
        return logsumexp(log_masses, axis=-1) + np.log((self.high - self.low) / CELLS)


class SplinePolicy(Policy):
    """The network gives the coefficients of n_splines cubic B-splines a dimension: log π is their sum less log Z.

    That is the density at the 65 nodes of a uniform grid, and between them it is linear.
    """

    label: ClassVar[str] = "spline"
    noise_marginals: ClassVar[Marginal] = "uniform"

    n_splines: Annotated[int, AtLeast(4)] = 10
    """B-splines for each action dimension, on uniform knots from bound to bound."""
    initial_policy: Literal["uniform", "gaussian"] = "uniform"
    """It starts uniform, or as the Gaussian of log_std_init that is cut off at the box."""
    log_std_init: Finite = 0.0
    """log σ of the Gaussian that it may start like."""
    box_units: Units = 0.0
    """1: that Gaussian is in units of the box; 0: in the environment's own."""
    deterministic_action: Literal["mode", "mean"] = "mode"
    """The action without exploration."""

    @property
    def n_outputs(self) -> int:
        """The coefficients of each dimension."""
        return len(self._box.low) * self.n_splines

    def init(self) -> tuple[Float[Array, " n_outputs"], Params]:
        """Coefficients 0, or those of −(a − μ)² / 2σ², which cubic splines have exactly, by its blossom."""
        if self.initial_policy == "uniform":
            return jnp.zeros(self.n_outputs), {}
        shift, scale = (jnp.reshape(x, (-1, 1)) for x in units_of(self, self.box_units))
        low, size = self.low[:, None], (self.high - self.low)[:, None]
        z = (low + size * knots(self.n_splines).astype(low.dtype) - shift) / (scale * jnp.exp(self.log_std_init))
        u, v, w = z[:, 1:-3], z[:, 2:-2], z[:, 3:-1]
        return (-(u * v + u * w + v * w) / 6).ravel(), {}

    def noise(self, key: Key[Array, ""], shape: tuple[int, ...]) -> Float[Array, "*batch n"]:
        """Uniform numbers, two per action dimension."""
        return jax.random.uniform(key, (*shape, 2 * len(self._box.low)))

    def distribution(self, outputs: Float[Array, "*batch n_outputs"], params: Params) -> Spline:
        """The densities whose logarithms have these coefficients."""
        coefficients = outputs.reshape(*outputs.shape[:-1], len(self._box.low), self.n_splines)
        return Spline(coefficients, self.low, self.high, self.deterministic_action)


def nodes(low: Float[np.ndarray, " d"], high: Float[np.ndarray, " d"]) -> Float[np.ndarray, "d nodes"]:
    """The nodes of each dimension; the last is the bound itself."""
    inner = low[:, None] + (high - low)[:, None] / CELLS * np.arange(CELLS, dtype=low.dtype)
    return np.concatenate([inner, high[:, None]], -1)


def knots(n: int) -> Float[np.ndarray, " knots"]:
    """The clamped uniform knots of n cubic B-splines on [0, 1]."""
    return np.concatenate([np.zeros(3), np.linspace(0, 1, n - 2), np.ones(3)])


@functools.cache
def basis(n: int) -> Float[np.ndarray, "nodes {n}"]:
    """The values of n cubic B-splines at the nodes, by the recursion of Cox and de Boor."""
    t, x = knots(n), np.linspace(0, 1, CELLS + 1)[:, None]
    b = ((t[:-1] <= x) & (x < t[1:])).astype(float)
    b[-1, n - 1] = 1.0
    for k in (1, 2, 3):
        spans = t[k:] - t[:-k]
        rise = np.divide(x - t[:-k], spans, out=np.zeros((len(x), len(spans))), where=spans > 0)
        b = rise[:, :-1] * b[:, :-1] + (1 - rise[:, 1:]) * b[:, 1:]
    return b
