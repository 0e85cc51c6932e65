"""Softmax policies whose logits are a Gaussian's at the centers of the bins, alone or with free ones added."""

import dataclasses
import functools
from typing import Any, ClassVar, NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from galton.policies.binned import BinnedPolicy
from galton.policies.gaussian import units_of
from galton.policies.histogram import Histogram
from galton.types import NotNegative, Params


class Bell(NamedTuple):
    """A Gaussian and the bins' centers, all in the policy's units."""

    mean: Array
    """`[*batch, d]`, as the log σ of each dimension is `[d]` and its bins' centers are `[d, k]`."""
    log_std: Array
    centers: Array
    shift: Any = 0.0
    scale: Any = 1.0

    def logits(self) -> Float[Array, "*batch d k"]:
        """−(c − μ)² / 2σ² for each bin's center c."""
        return -0.5 * ((self.centers - self.mean[..., None]) * jnp.exp(-self.log_std)[:, None]) ** 2

    def nearest(self) -> Float[Array, "*batch d"]:
        """The center that is nearest to the mean; no gradient flows through it."""
        first, width, last = self.centers[:, 0], self.centers[:, 1] - self.centers[:, 0], self.centers.shape[1] - 1
        index = jnp.clip(jnp.round((jax.lax.stop_gradient(self.mean) - first) / width), 0, last).astype(int)
        return self.centers[jnp.arange(len(self.centers)), index]

    def excess(
        self, center: Float[Array, "..."], nearest: Float[Array, "..."]
    ) -> tuple[Float[Array, "..."], Float[Array, "..."]]:
        """The distance s of a center from the nearest one, in σ, and how much more its squared one from the mean is.

        That is e = s (s + 2 z) with the nearest center's distance z from the mean. Nothing large is subtracted, however
        far out the mean is.
        """
        per_std = jnp.exp(-self.log_std)
        s = (center - nearest) * per_std
        return s, s * (s + 2 * (nearest - self.mean) * per_std)


class Sums(NamedTuple):
    """The bins add up to these numbers where each has the weight exp(−e / 2), see `Bell.excess`."""

    log_total: Array
    """The logarithm of the sum of all weights, `[*batch, d]`."""
    mean_excess: Array
    """E e under the policy."""


@jax.custom_jvp
def sums(bell: Bell) -> Sums:
    """Add up the bins, in one pass over them, which tells the gradients too."""
    return Sums(*_moments(bell, 2)[:2])


@sums.defjvp
def _(primals: tuple[Bell], tangents: tuple[Any]) -> tuple[Sums, Sums]:
    """The weights move by e, that by −2 s / σ with the mean and by −2 e with log σ."""
    (bell,), (moved,) = primals, tangents
    log_total, e, s, e_s, e_e = _moments(bell, 5)
    by_mean, by_log_std = jnp.exp(-bell.log_std) * moved.mean, moved.log_std
    of_total = s * by_mean + e * by_log_std
    of_excess = (e_s - e * s - 2 * s) * by_mean + (e_e - e**2 - 2 * e) * by_log_std
    return Sums(log_total, e), Sums(of_total, of_excess)


def _moments(bell: Bell, n: int) -> list[Array]:
    """The first n of: the logarithm of all weights' sum, and under the policy E e, E s, E e s and E e².

    Bins are the first axis: over that a processor adds many entries at once.
    """
    bins_first = bell.centers.T.reshape(-1, *[1] * (bell.mean.ndim - 1), bell.mean.shape[-1])
    s, e = bell.excess(bins_first, bell.nearest())
    weights = jnp.exp(-0.5 * e)
    total = weights.sum(0)
    return [jnp.log(total), *((weights * x).sum(0) / total for x in (e, s, e * s, e**2)[: n - 1])]


@dataclasses.dataclass(frozen=True)
class DiscretisedGaussian(Histogram):
    """Π_l softmax(logits_l) with a Gaussian's logits; few sums over the bins tell what a loss needs of them."""

    bell: Bell = dataclasses.field(kw_only=True)
    """The Gaussian whose logits these are, and the centers in its units."""

    @functools.cached_property
    def sums(self) -> Sums:
        """The bins' sums, of which a program has one copy."""
        return sums(self.bell)

    def log_prob(self, action: Float[Array, "*batch d"]) -> Float[Array, "*batch"]:
        """Σ_l log π_l of the bin that holds the action; a Gaussian's log-density where a Gaussian explores."""
        return super().log_prob(action) if self.choices.exploration == "gaussian" else self.log_prob_of_bins(action)

    def log_prob_of_bins(self, action: Float[Array, "*batch d"]) -> Float[Array, "*batch"]:
        """Σ_l log π_l of the bin that holds the action."""
        center = self.bins.decode(self.bins.encode(action))
        _, excess = self.bell.excess((center - self.bell.shift) / self.bell.scale, self.bell.nearest())
        return (-0.5 * excess - self.sums.log_total).sum(-1)

    def entropy(self) -> Float[Array, "*batch"]:
        """−Σ_l Σ_i π log π, which is log Σ_i exp(−e_i / 2) + E e / 2 of each dimension."""
        return (self.sums.log_total + 0.5 * self.sums.mean_excess).sum(-1)


class DiscretisedGaussianPolicy(BinnedPolicy):
    """The network gives the mean μ of each dimension; bin i has the logit −(c_i − μ)² / 2σ², with its center c_i.

    It is the Gaussian policy on bins: one output a dimension, log σ a parameter that is the same in every state, and a
    likelihood that is exact in a bounded box, for a mean beyond a bound puts its mass on the last bin.
    """

    label: ClassVar[str] = "discretised Gaussian"

    @property
    def n_outputs(self) -> int:
        """One mean per action dimension."""
        return len(self._box.low)

    def init(self) -> tuple[Float[Array, " n_outputs"], Params]:
        """Outputs 0, and σ = exp(log_std_init), in the policy's units."""
        return jnp.zeros(self.n_outputs), {"log_std": jnp.zeros(len(self._box.low)) + self.log_std_init}

    def distribution(self, outputs: Float[Array, "*batch n_outputs"], params: Params) -> Histogram:
        """The softmax policies of these means, as wide as the parameters say."""
        bell = self.bell(outputs, params)
        return DiscretisedGaussian(self.bins, bell.logits(), self.choices, bell=bell)

    def bell(self, mean: Float[Array, "*batch d"], params: Params) -> Bell:
        """The Gaussian of these means, in the policy's units (`box_units`)."""
        shift, scale = units_of(self, self.box_units)
        centers = (jnp.asarray(self.bins.centers) - jnp.reshape(shift, (-1, 1))) / jnp.reshape(scale, (-1, 1))
        return Bell(mean, jnp.maximum(params["log_std"], self.log_std_min), centers, shift, scale)


class AnchoredPolicy(DiscretisedGaussianPolicy):
    """The network gives k residuals r and the mean μ of each dimension: the logits are −(c_i − μ)² / 2σ² + S r_i.

    So it starts as a Gaussian that moves as fast as one, and may become any other shape. The scale S is
    `residual_scale`.
    """

    label: ClassVar[str] = "anchored softmax"

    residual_scale: NotNegative = 1.0
    """The residuals are multiplied with this number, which under Adam is their learning rate in units of the mean's;
    with 0 the shape is a Gaussian's."""

    @property
    def n_outputs(self) -> int:
        """The residuals of each dimension's bins, and then its mean."""
        return len(self._box.low) * (self.n_bins + 1)

    def distribution(self, outputs: Float[Array, "*batch n_outputs"], params: Params) -> Histogram:
        """The softmax policies of the Gaussian's logits plus the residuals."""
        parts = outputs.reshape(*outputs.shape[:-1], len(self._box.low), self.n_bins + 1)
        logits = self.bell(parts[..., -1], params).logits() + self.residual_scale * parts[..., :-1]
        return Histogram(self.bins, logits, self.choices)
