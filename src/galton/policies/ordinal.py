"""The ordinal softmax policy: logits that know that bins are in order (Tang & Agrawal, 2020)."""

import dataclasses
from typing import ClassVar

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Key

from galton.policies.base import Family, Marginal
from galton.policies.histogram import Histogram, HistogramPolicy
from galton.types import Config, Hypers, Params


@dataclasses.dataclass(frozen=True, eq=False)
class OrdinalPolicy:
    """The network gives k outputs f per dimension; bin i has the logit Σ_{j≤i} log s_j + Σ_{j>i} log(1 − s_j).

    With s = sigmoid(f) each factor says whether the action lies at least so far up. Since log s − log(1 − s) = f,
    these logits are the cumulative sum of f plus a constant, which a softmax does not notice.
    """

    histogram: HistogramPolicy

    family: ClassVar[Family] = "histogram"
    label: ClassVar[str] = "ordinal softmax"

    @classmethod
    def create(cls, config: Config, low: Float[np.ndarray, " d"], high: Float[np.ndarray, " d"]) -> "OrdinalPolicy":
        """The policy for actions in the box [low, high]: everything but the logits is the softmax policy's."""
        return cls(HistogramPolicy.create(config, low, high))

    @property
    def n_outputs(self) -> int:
        """The k outputs of each action dimension."""
        return self.histogram.n_outputs

    def init(self, hypers: Hypers) -> tuple[Float[Array, " dk"], Params]:
        """Outputs whose cumulative sums are the softmax policy's first logits."""
        logits, params = self.histogram.init(hypers)
        return jnp.diff(self._by_dimension(logits), axis=-1, prepend=0.0).ravel(), params

    @property
    def noise_marginals(self) -> Marginal:
        """How the noise is distributed: as the softmax policy's."""
        return self.histogram.noise_marginals

    def noise(self, key: Key[Array, ""], shape: tuple[int, ...]) -> Float[Array, "*batch n"]:
        """What the softmax policy draws, since sampling is the same."""
        return self.histogram.noise(key, shape)

    def distribution(self, outputs: Float[Array, "*batch dk"], params: Params, hypers: Hypers) -> Histogram:
        """Softmax policies whose logits are cumulative sums of the outputs."""
        logits = jnp.cumsum(self._by_dimension(outputs), -1).reshape(outputs.shape)
        return self.histogram.distribution(logits, params, hypers)

    def _by_dimension(self, outputs: Float[Array, "*batch dk"]) -> Float[Array, "*batch d k"]:
        return outputs.reshape(*outputs.shape[:-1], *self.histogram.bins.centers.shape)
