"""The ordinal softmax policy: logits that know that bins are in order (Tang & Agrawal, 2020)."""

from typing import ClassVar

import jax.numpy as jnp
from jaxtyping import Array, Float

from galton.policies.binned import HistogramPolicy
from galton.policies.histogram import Histogram
from galton.types import Params


class OrdinalPolicy(HistogramPolicy):
    """The network gives k outputs f per dimension; bin i has the logit Σ_{j≤i} log s_j + Σ_{j>i} log(1 − s_j).

    With s = sigmoid(f) each factor says whether the action lies at least so far up. Since log s − log(1 − s) = f,
    these logits are the cumulative sum of f plus a constant, which a softmax does not notice.
    """

    label: ClassVar[str] = "ordinal softmax"

    def init(self) -> tuple[Float[Array, " dk"], Params]:
        """Outputs whose cumulative sums are the softmax policy's first logits."""
        logits, params = super().init()
        return jnp.diff(self.by_dimension(logits), axis=-1, prepend=0.0).ravel(), params

    def distribution(self, outputs: Float[Array, "*batch dk"], params: Params) -> Histogram:
        """Softmax policies whose logits are cumulative sums of the outputs."""
        logits = jnp.cumsum(self.by_dimension(outputs), -1)
        return super().distribution(logits.reshape(outputs.shape), params)
