"""The smoothed softmax policy: neighbouring bins share what the network says, in the policy and not in the target."""

import dataclasses
from typing import ClassVar

import jax.numpy as jnp
from jaxtyping import Array, Float

from galton import targets
from galton.policies.histogram import Histogram, HistogramPolicy
from galton.types import Hypers, Params


@dataclasses.dataclass(frozen=True, eq=False)
class SmoothedPolicy(HistogramPolicy):
    """The network gives k outputs z per dimension; bin i has the logit Σ_j K_ij z_j plus its first logit.

    Row i of K is the HL-Gauss target of bin i's center with width η: the logits are a moving average of z. With the
    loss hl-one-hot an action in bin a moves z along K_a − Kᵀπ, as centred HL-Gauss moves a softmax's logits. Here it is
    the exact gradient of the policy's own log-probability, so that nothing has to be centred away and PPO's ratio is
    the policy's.
    """

    label: ClassVar[str] = "smoothed softmax"

    def init(self, hypers: Hypers) -> tuple[Float[Array, " dk"], Params]:
        """Outputs 0, which leave every bin its first logit."""
        del hypers
        return jnp.zeros(self.n_outputs), {}

    def distribution(self, outputs: Float[Array, "*batch dk"], params: Params, hypers: Hypers) -> Histogram:
        """Softmax policies whose logits are moving averages of the outputs."""
        logits = (self.by_dimension(outputs) @ self.kernel(hypers).T).reshape(outputs.shape)
        return super().distribution(logits + self.first_logits(hypers), params, hypers)

    def kernel(self, hypers: Hypers) -> Float[Array, "k k"]:
        """K, whose rows sum to 1."""
        n_bins, tails = self.bins.n_bins, self.choices.target_tails
        return targets.hl_gauss_of_center(n_bins, jnp.arange(n_bins), hypers.eta, tails, self.bins.bin_centers)

    def first_logits(self, hypers: Hypers) -> Float[Array, " dk"] | float:
        """The softmax policy's first logits, which stay what they are; 0 for a uniform start."""
        return 0.0 if self.initial_policy == "uniform" else super().init(hypers)[0]
