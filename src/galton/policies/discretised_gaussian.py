"""Softmax policies whose logits are a Gaussian's at the centers of the bins, alone or with free ones added."""

from typing import ClassVar

import jax.numpy as jnp
from jaxtyping import Array, Float

from galton.policies.gaussian import units_of
from galton.policies.histogram import BinnedPolicy, Histogram
from galton.types import NotNegative, Params


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
        return Histogram(self.bins, self.logits(outputs, params), self.choices)

    def logits(self, mean: Float[Array, "*batch d"], params: Params) -> Float[Array, "*batch d k"]:
        """−(c − μ)² / 2σ² for each bin's center c; μ and σ are in the policy's units (`box_units`)."""
        shift, scale = units_of(self, self.box_units)
        std = jnp.exp(jnp.maximum(params["log_std"], self.log_std_min))[:, None]
        centers = (jnp.asarray(self.bins.centers) - jnp.reshape(shift, (-1, 1))) / jnp.reshape(scale, (-1, 1))
        return -0.5 * ((centers - mean[..., None]) / std) ** 2


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

    def logits(self, outputs: Float[Array, "*batch n_outputs"], params: Params) -> Float[Array, "*batch d k"]:
        """The Gaussian's logits plus the residuals."""
        parts = outputs.reshape(*outputs.shape[:-1], len(self._box.low), self.n_bins + 1)
        return super().logits(parts[..., -1], params) + self.residual_scale * parts[..., :-1]
