"""One softmax over a grid of all action dimensions (§4.1), which can correlate them."""

import functools
from typing import ClassVar, Literal

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, Key

from galton.bins import Bins, GridBins
from galton.errors import require
from galton.parts import Box
from galton.policies.binned import BinnedPolicy, started
from galton.policies.gaussian import units_of
from galton.policies.histogram import Histogram
from galton.types import Params

MOST_DIMENSIONS, MOST_CELLS = 3, 20_000
"""A grid has at most so many dimensions, and cells."""


class JointPolicy(BinnedPolicy):
    """The network gives a logit for each of the k^d cells of a grid over all dimensions, in at most three of them.

    Any dependence between dimensions can be learned. The target of a wide loss is the product of its dimensions'.
    """

    label: ClassVar[str] = "joint softmax"

    initial_policy: Literal["uniform", "gaussian", "clipped-gaussian"] = "uniform"
    """The policy starts uniform, or as the product of what the softmax policy starts with in each dimension."""
    deterministic_action: Literal["mode", "mean"] = "mode"
    """The action without exploration: the center of the most likely cell, or the mean."""

    def on(self, box: Box) -> "JointPolicy":
        """The policy for actions in this box.

        Raises:
            UsageError: a box of too many dimensions, or cells.
        """
        d = len(box.low)
        require(
            d <= MOST_DIMENSIONS,
            f"policy is 'joint', and actions have {d} dimensions; it takes at most {MOST_DIMENSIONS}, so take "
            "policy 'autoregressive'",
        )
        most = int(MOST_CELLS ** (1 / d) + 1e-9)
        require(
            self.n_bins <= most,
            f"n_bins is {self.n_bins}, which makes {self.n_bins**d} cells in {d} dimensions; policy 'joint' takes at "
            f"most {MOST_CELLS}, so make n_bins {most} or less",
        )
        return super().on(box)

    @property
    def bins(self) -> GridBins:
        """The cells of the box."""
        return _grid(super().bins)

    @property
    def n_outputs(self) -> int:
        """A logit for each cell."""
        return self.bins.n_bins

    def init(self) -> tuple[Float[Array, " n_outputs"], Params]:
        """Uniform, or as the Gaussian policy starts with the same numbers."""
        shift, scale = (jnp.reshape(x, (-1, 1)) for x in units_of(self, self.box_units))
        std = scale * jnp.exp(jnp.maximum(self.log_std_init, self.log_std_min))
        rows = started(self.initial_policy, self.bins.axes, shift, std)
        return sum(jnp.meshgrid(*rows, indexing="ij"), jnp.zeros(())).ravel(), {}

    def noise(self, key: Key[Array, ""], shape: tuple[int, ...]) -> Float[Array, "*batch n"]:
        """A uniform number, and d more where the place in it is drawn; d normal ones where a Gaussian explores."""
        d = len(self._box.low)
        if self.exploration == "gaussian":
            return jax.random.normal(key, (*shape, d))
        return jax.random.uniform(key, (*shape, 1 if self.bin_sample == "center" else 1 + d))

    def distribution(self, outputs: Float[Array, "*batch n_outputs"], params: Params) -> Histogram:
        """The softmax over the cells with these logits."""
        return Histogram(self.bins, outputs[..., None, :], self.choices)


@functools.lru_cache(maxsize=64)
def _grid(axes: Bins) -> GridBins:
    return GridBins(axes)
