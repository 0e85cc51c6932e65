"""The smoothed softmax policy: neighbouring bins share what the network says, in the policy and not in the target."""

import dataclasses
from typing import ClassVar

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Key

from galton import targets
from galton.policies.base import Family, Marginal
from galton.policies.histogram import Histogram, HistogramPolicy
from galton.types import Config, Hypers, Params


@dataclasses.dataclass(frozen=True, eq=False)
class SmoothedPolicy:
    """The network gives k outputs z per dimension; bin i has the logit Σ_j K_ij z_j plus its first logit.

    Row i of K is the HL-Gauss target of bin i's center with width η: the logits are a moving average of z. With the
    loss hl-one-hot an action in bin a moves z along K_a − Kᵀπ, as centred HL-Gauss moves a softmax's logits. Here it is
    the exact gradient of the policy's own log-probability, so that nothing has to be centred away and PPO's ratio is
    the policy's.
    """

    histogram: HistogramPolicy

    family: ClassVar[Family] = "histogram"
    label: ClassVar[str] = "smoothed softmax"

    @classmethod
    def create(cls, config: Config, low: Float[np.ndarray, " d"], high: Float[np.ndarray, " d"]) -> "SmoothedPolicy":
        """The policy for actions in the box [low, high]: everything but the logits is the softmax policy's."""
        return cls(HistogramPolicy.create(config, low, high))

    @property
    def n_outputs(self) -> int:
        """The k outputs of each action dimension."""
        return self.histogram.n_outputs

    def init(self, hypers: Hypers) -> tuple[Float[Array, " dk"], Params]:
        """Outputs 0, which leave every bin its first logit."""
        del hypers
        return jnp.zeros(self.n_outputs), {}

    @property
    def noise_marginals(self) -> Marginal:
        """How the noise is distributed: as the softmax policy's."""
        return self.histogram.noise_marginals

    def noise(self, key: Key[Array, ""], shape: tuple[int, ...]) -> Float[Array, "*batch n"]:
        """What the softmax policy draws, since sampling is the same."""
        return self.histogram.noise(key, shape)

    def distribution(self, outputs: Float[Array, "*batch dk"], params: Params, hypers: Hypers) -> Histogram:
        """Softmax policies whose logits are moving averages of the outputs."""
        z = outputs.reshape(*outputs.shape[:-1], *self.histogram.bins.centers.shape)
        logits = (z @ self.kernel(hypers).T).reshape(outputs.shape)
        return self.histogram.distribution(logits + self.first_logits(hypers), params, hypers)

    def kernel(self, hypers: Hypers) -> Float[Array, "k k"]:
        """K, whose rows sum to 1."""
        bins, tails = self.histogram.bins, self.histogram.choices.target_tails
        return targets.hl_gauss_of_center(bins.n_bins, jnp.arange(bins.n_bins), hypers.eta, tails, bins.bin_centers)

    def first_logits(self, hypers: Hypers) -> Float[Array, " dk"] | float:
        """The softmax policy's first logits, which stay what they are; 0 for a uniform start."""
        return 0.0 if self.histogram.initial_policy == "uniform" else self.histogram.init(hypers)[0]
