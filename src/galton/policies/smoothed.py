"""The smoothed softmax policy: neighbouring bins share what the network says, in the policy and not in the target."""

from typing import ClassVar

import jax.numpy as jnp
from jaxtyping import Array, Float

from galton import targets
from galton.policies.binned import HistogramPolicy
from galton.policies.histogram import Histogram
from galton.types import Params, Positive


class SmoothedPolicy(HistogramPolicy):
    """The network gives k outputs z per dimension; bin i has the logit Σ_j K_ij z_j plus its first logit.

    Row i of K is the HL-Gauss target of bin i's center with width η: the logits are a moving average of z. With the
    loss hl-one-hot an action in bin a moves z along K_a − Kᵀπ, as centred HL-Gauss moves a softmax's logits. Here it is
    the exact gradient of the policy's own log-probability, so that nothing has to be centred away and PPO's ratio is
    the policy's.
    """

    label: ClassVar[str] = "smoothed softmax"

    eta: Positive = 0.25
    """The width of the moving average, in bins."""
    target_tails: targets.Tails = "rescaled"
    """Mass beyond the box: the rest is rescaled to sum to 1, it is folded back, or the bin at that end gets it."""

    def init(self) -> tuple[Float[Array, " dk"], Params]:
        """Outputs 0, which leave every bin its first logit."""
        return jnp.zeros(self.n_outputs), {}

    def distribution(self, outputs: Float[Array, "*batch dk"], params: Params) -> Histogram:
        """Softmax policies whose logits are moving averages of the outputs."""
        logits = (self.by_dimension(outputs) @ self.kernel().T).reshape(outputs.shape)
        return super().distribution(logits + self.first_logits(), params)

    def kernel(self) -> Float[Array, "k k"]:
        """K, whose rows sum to 1."""
        index = jnp.arange(self.n_bins)
        return targets.hl_gauss_of_center(self.n_bins, index, self.eta, self.target_tails, self.bin_centers)

    def first_logits(self) -> Float[Array, " dk"] | float:
        """The softmax policy's first logits, which stay what they are; 0 for a uniform start."""
        return 0.0 if self.initial_policy == "uniform" else super().init()[0]
