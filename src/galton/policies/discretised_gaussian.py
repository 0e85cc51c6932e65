"""Softmax policies whose logits are a Gaussian's at the centers of the bins, alone or with free ones added."""

import dataclasses
from typing import Any, ClassVar, NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from galton.policies.gaussian import units_of
from galton.policies.histogram import BinnedPolicy, Histogram
from galton.types import NotNegative, Params


class Bell(NamedTuple):
    """A Gaussian and the bins' centers, all in the policy's units."""

    mean: Array
    """`[*batch, d]`, as the log σ of each dimension is `[d]` and its bins' centers are `[d, k]`."""
    log_std: Array
    centers: Array

    def logits(self) -> Float[Array, "*batch d k"]:
        """−(c − μ)² / 2σ² for each bin's center c."""
        return -0.5 * ((self.centers - self.mean[..., None]) * jnp.exp(-self.log_std)[:, None]) ** 2

    def nearest(self) -> Float[Array, "*batch d"]:
        """The center that is nearest to the mean; no gradient flows through it."""
        first, width, last = self.centers[:, 0], self.centers[:, 1] - self.centers[:, 0], self.centers.shape[1] - 1
        place = jnp.clip(jnp.round((jax.lax.stop_gradient(self.mean) - first) / width), 0, last)
        return self.centers[jnp.arange(len(first)), place.astype(int)]

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

    def sums(self) -> "Sums":
        """Add up the bins, in one pass over them."""
        by_bins = Bell(self.mean[..., None], self.log_std[..., None], self.centers)
        s, excess = by_bins.excess(self.centers, self.nearest()[..., None])
        weights = jnp.exp(-0.5 * excess)
        total = weights.sum(-1)
        return Sums(jnp.log(total), (weights * s).sum(-1) / total, (weights * excess).sum(-1) / total)


class Sums(NamedTuple):
    """What the bins add up to where each has the weight exp(−e / 2), see `Bell.excess`."""

    log_total: Float[Array, "*batch d"]
    """The logarithm of the sum of all weights."""
    s: Float[Array, "*batch d"]
    """E s under the policy."""
    excess: Float[Array, "*batch d"]
    """E e under the policy."""


@jax.custom_jvp
def log_total(bell: Bell) -> Float[Array, "*batch d"]:
    """The logarithm of Σ exp(−e / 2), whose gradient is told by the same sums: E s / σ in the mean, E e in log σ."""
    return bell.sums().log_total


@log_total.defjvp
def _(primals: tuple[Bell], tangents: tuple[Any]) -> tuple[Array, Array]:
    (bell,), (moved,) = primals, tangents
    sums = bell.sums()
    return sums.log_total, sums.s * jnp.exp(-bell.log_std) * moved.mean + sums.excess * moved.log_std


@dataclasses.dataclass(frozen=True)
class DiscretisedGaussian(Histogram):
    """Π_l softmax(logits_l) with a Gaussian's logits; three sums over the bins tell what a loss needs of them."""

    bell: Bell = dataclasses.field(kw_only=True)
    """The Gaussian."""

    def log_prob(self, action: Float[Array, "*batch d"]) -> Float[Array, "*batch"]:
        """Σ_l log π_l of the bin that holds the action; a Gaussian's log-density where a Gaussian explores."""
        return super().log_prob(action) if self.choices.exploration == "gaussian" else self.log_prob_of_bins(action)

    def log_prob_of_bins(self, action: Float[Array, "*batch d"]) -> Float[Array, "*batch"]:
        """Σ_l log π_l of the bin that holds the action."""
        center = self.bell.centers[jnp.arange(len(self.bell.centers)), self.bins.encode(action)]
        return (-0.5 * self.bell.excess(center, self.bell.nearest())[1] - log_total(self.bell)).sum(-1)

    def entropy(self) -> Float[Array, "*batch"]:
        """−Σ_l Σ_i π log π, which is log Σ_i exp(−e_i / 2) + E e / 2 of each dimension."""
        sums = self.bell.sums()
        return (sums.log_total + 0.5 * sums.excess).sum(-1)


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
        shift, scale = (jnp.reshape(x, (-1, 1)) for x in units_of(self, self.box_units))
        centers = (jnp.asarray(self.bins.centers) - shift) / scale
        return Bell(mean, jnp.maximum(params["log_std"], self.log_std_min), centers)


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
