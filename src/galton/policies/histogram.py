"""The distribution over bins: a softmax for each action dimension, independent of the others (§4.1)."""

import dataclasses
import math
from typing import Literal, NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int

from galton import targets
from galton.bins import Bins, UnevenBins
from galton.types import Rule

Exploration = Literal["softmax", "gaussian"]
BinSample = Literal["center", "uniform"]


class Choices(NamedTuple):
    """A histogram leaves these choices open; they are the settings of HistogramPolicy with the same names."""

    exploration: Exploration = "softmax"
    bin_sample: BinSample = "center"
    deterministic_action: Rule = "mode"
    is_masked: bool = False
    """True if some bins may have no probability at all, which then are never drawn."""


USUAL = Choices()
NOWHERE = -1e9
"""The logit of what is no bin, or forbidden: its probability is 0, and so is its share of every sum and gradient."""


@dataclasses.dataclass(frozen=True)
class Histogram:
    """Π_l softmax(logits_l) over the bins of each dimension l; over the cells of a grid there is one softmax."""

    bins: Bins
    logits: Float[Array, "*batch d k"]
    choices: Choices = USUAL

    @property
    def probs(self) -> Float[Array, "*batch d k"]:
        """π(i | s) of each bin."""
        return jax.nn.softmax(self.logits)

    @property
    def allowed(self) -> Bool[Array, "*batch d k"]:
        """True for bins that may be drawn: neither padding nor forbidden by a mask."""
        return self.logits > NOWHERE / 2

    @property
    def samples_centers(self) -> bool:
        """True if every sampled action is the center of a bin."""
        return self.choices.exploration == "softmax" and self.choices.bin_sample == "center"

    def sample(self, noise: Float[Array, "*batch n"]) -> Float[Array, "*batch d"]:
        """An action, from the noise that HistogramPolicy.noise drew for this configuration."""
        d = self.logits.shape[-2]
        if self.choices.exploration == "gaussian":
            return self.mean() + self.std() * noise  # Gaussian Exploration (§5.2.3), which is not clipped
        index = self._drawn(noise[..., :d])
        if self.choices.bin_sample == "center":
            return self.bins.decode(index)
        return self.bins.within(index, noise[..., d:])

    def _drawn(self, u: Float[Array, "*batch d"]) -> Int[Array, "*batch d"]:
        """The bins where the cumulative distributions pass u."""
        exact = self.choices.is_masked or isinstance(self.bins, UnevenBins)
        return (sample_valid if exact else sample_bin)(self.logits, u)

    def log_prob(self, action: Float[Array, "*batch d"]) -> Float[Array, "*batch"]:
        """Σ_l log π_l of the bin that holds the action; the Gaussian's log-density where a Gaussian explores.

        Where the place in the bin is drawn too, its density is a constant of the bin, −log of the bin's width, which is
        left out.
        """
        if self.choices.exploration == "gaussian":
            std = jnp.sqrt(jnp.maximum(self.variance(), (1e-6 * self.bins.width) ** 2))  # certain policies have none
            z = (action - self.mean()) / std
            return (-0.5 * z**2 - jnp.log(std) - 0.5 * math.log(2 * math.pi)).sum(-1)
        index = self.bins.encode(action)[..., None]
        return jnp.take_along_axis(jax.nn.log_softmax(self.logits), index, -1)[..., 0].sum(-1)

    def log_prob_of_bins(self, action: Float[Array, "*batch d"]) -> Float[Array, "*batch"]:
        """Σ_l log π_l of the bin that holds the action, as the sum over all bins whose gradient is quick."""
        return (targets.one_hot(self.bins, action) * jax.nn.log_softmax(self.logits)).sum((-2, -1))

    def mean(self) -> Float[Array, "*batch d"]:
        """The mean of the bin centers under π."""
        return (self.probs * self.bins.centers).sum(-1)

    def entropy(self) -> Float[Array, "*batch"]:
        """−Σ_l Σ_i π log π."""
        log_probs = jax.nn.log_softmax(self.logits)
        return -(jnp.exp(log_probs) * log_probs).sum((-2, -1))

    def kl(self, other: "Histogram") -> Float[Array, "*batch"]:
        """KL(self ‖ other) = Σ_l Σ_i π (log π − log π')."""
        log_probs = jax.nn.log_softmax(self.logits)
        return (jnp.exp(log_probs) * (log_probs - jax.nn.log_softmax(other.logits))).sum((-2, -1))

    def kl_parts(self, other: "Histogram") -> dict[str, Float[Array, "*batch"]]:
        """The same under the name "bins"."""
        return {"bins": self.kl(other)}

    def std(self) -> Float[Array, "*batch d"]:
        """The effective σ: the standard deviation of the bin centers under π."""
        return jnp.sqrt(self.variance())

    def variance(self) -> Float[Array, "*batch d"]:
        """The variance of the bin centers under π."""
        return (self.probs * (self.bins.centers - self.mean()[..., None]) ** 2).sum(-1)

    def at_edge(self, action: Float[Array, "*batch d"]) -> Bool[Array, "*batch d"]:
        """Return True for entries in the first or last bin of a dimension, or beyond."""
        return self.bins.at_edge(action)

    def deterministic_action(self) -> Float[Array, "*batch d"]:
        """The center of the most likely bin, the mean of the centers, or the median's center; of a choice the mode.

        A mean in a bin that a mask forbids becomes the nearest center of one that is allowed.
        """
        mode = self.bins.decode(self.logits.argmax(-1))
        if self.choices.deterministic_action == "mode":
            return mode
        if self.choices.deterministic_action == "mean":
            action = jnp.clip(self.mean(), self.bins.low, self.bins.high)  # a rounded mean of bounds may lie beyond
            action = self._nearest_allowed(action) if self.choices.is_masked else action
        else:
            action = self.bins.decode(self._drawn(jnp.full(self.logits.shape[:-1], 0.5)))
        return jnp.where(self.bins.is_choice, mode, action) if isinstance(self.bins, UnevenBins) else action

    def _nearest_allowed(self, action: Float[Array, "*batch d"]) -> Float[Array, "*batch d"]:
        """The action where its bin is allowed, and else the nearest center of one that is."""
        allowed = self.allowed
        distance = jnp.where(allowed, jnp.abs(self.bins.centers - action[..., None]), jnp.inf)
        inside = jnp.take_along_axis(allowed, self.bins.encode(action)[..., None], -1)[..., 0]
        return jnp.where(inside, action, self.bins.decode(distance.argmin(-1)))


def sample_bin(logits: Float[Array, "*batch k"], u: Float[Array, "*batch"]) -> Int[Array, "*batch"]:
    """The bin where the cumulative distribution passes u in [0, 1): inverse-CDF sampling.

    In two levels of about √k, first among blocks of bins, then inside one: cumulative sums are what sampling
    costs, and short ones are cheap.
    """
    k = logits.shape[-1]
    size = math.isqrt(k - 1) + 1
    weights = jnp.exp(logits - logits.max(-1, keepdims=True))
    padding = [(0, 0)] * (weights.ndim - 1) + [(0, -k % size)]
    blocks = jnp.pad(weights, padding).reshape(*u.shape, -1, size)

    mass = blocks.sum(-1)
    cumulative = jnp.cumsum(mass, -1)
    threshold = u * cumulative[..., -1]
    block = (cumulative[..., :-1] <= threshold[..., None]).sum(-1)

    here = block[..., None]
    before = jnp.take_along_axis(cumulative - mass, here, -1)
    inside = jnp.cumsum(jnp.take_along_axis(blocks, here[..., None], -2)[..., 0, :], -1)
    offset = (inside[..., :-1] <= threshold[..., None] - before).sum(-1)
    return jnp.minimum(block * size + offset, k - 1)


def sample_valid(logits: Float[Array, "*batch k"], u: Float[Array, "*batch"]) -> Int[Array, "*batch"]:
    """The same where some bins have no probability at all: none of them is ever drawn, however sums round."""
    weights = jnp.exp(logits - logits.max(-1, keepdims=True))
    cumulative = jnp.cumsum(weights, -1)
    passed = (cumulative > u[..., None] * cumulative[..., -1:]) & (weights > 0)
    last = weights.shape[-1] - 1 - jnp.argmax(weights[..., ::-1] > 0, -1)
    return jnp.where(passed.any(-1), passed.argmax(-1), last)
