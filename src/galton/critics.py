"""Critics by name: what the critic network's outputs say a state is worth, and how they are trained towards returns.

A new one is a class in a file and a line in CRITICS.
"""

import abc
from typing import Annotated, ClassVar

import jax
import jax.numpy as jnp
import numpy as np
from jax.nn import log_softmax
from jaxtyping import Array, Float

from galton import targets
from galton.bins import Bins
from galton.errors import UsageError, require
from galton.fields import AtLeast
from galton.parts import Part
from galton.types import Finite, Positive


class Critic(Part, abc.ABC):
    """A critic turns network outputs into values. An entry of CRITICS is a class of this kind."""

    init_scale: ClassVar[float] = 1.0
    """The scale of the orthogonal kernel that the network's last layer starts with."""

    def check(self, normalize_reward: bool) -> None:
        """Raise UsageError where it doesn't fit the rewards that it sees."""

    @property
    @abc.abstractmethod
    def n_outputs(self) -> int:
        """Outputs that the critic network must have."""

    @abc.abstractmethod
    def value(self, outputs: Float[Array, "*batch n_outputs"]) -> Float[Array, "*batch"]:
        """Return the value of each state, v(s)."""

    @abc.abstractmethod
    def loss(
        self, outputs: Float[Array, "*batch n_outputs"], returns: Float[Array, "*batch"]
    ) -> Float[Array, "*batch"]:
        """Return each sample's loss, which is minimised with the weight vf_coef."""


class SquaredErrorCritic(Critic):
    """One output, the value, trained by (return − value)², as SB3's."""

    label: ClassVar[str] = "squared error"

    @property
    def n_outputs(self) -> int:
        """One output, the value of the state."""
        return 1

    def value(self, outputs: Float[Array, "*batch 1"]) -> Float[Array, "*batch"]:
        """The network's one output, as it is."""
        return outputs[..., 0]

    def loss(self, outputs: Float[Array, "*batch 1"], returns: Float[Array, "*batch"]) -> Float[Array, "*batch"]:
        """The squared error, (return − value)², of each sample."""
        return (returns - self.value(outputs)) ** 2


class Classifier(Critic):
    """n logits over bins of equal width between value_min and value_max, trained by a cross-entropy.

    The value is the mean of the bin centers under the softmax. A return beyond the first or last center is trained
    as that center's.
    """

    init_scale: ClassVar[float] = 0.01

    n_value_bins: Annotated[int, AtLeast(2)] = 101
    """Its number of bins."""
    value_min: Finite = -10.0
    """The least return that there is a bin for, in the units of the rewards that it sees; with normalize_reward that is
    about one standard deviation of the discounted return."""
    value_max: Finite = 10.0
    """The greatest, in the same units."""

    def check(self, normalize_reward: bool) -> None:
        """Raise UsageError for a support that is none, or that nobody chose for rewards in units of their own."""
        low, high = np.broadcast_arrays(self.value_min, self.value_max)
        for least, most in zip(low[low >= high][:1], high[low >= high][:1], strict=True):
            raise UsageError(f"value_min is {least} and value_max {most}; value_min must be the smaller one")
        usual = type(self)()
        fits = normalize_reward or np.all((low != usual.value_min) | (high != usual.value_max))
        require(
            fits,
            f"critic is {self.label!r}, whose bins go from value_min = {usual.value_min:g} to value_max = "
            f"{usual.value_max:g}, which fits normalised rewards; set normalize_reward, or value_min and value_max to "
            "the least and greatest discounted return of your task, one of them another number",
        )

    @property
    def bins(self) -> Bins:
        """Those of the support's unit interval: 0 is value_min, 1 value_max."""
        return Bins(0.0, 1.0, self.n_value_bins)

    @property
    def n_outputs(self) -> int:
        """One logit per bin."""
        return self.n_value_bins

    def value(self, outputs: Float[Array, "*batch k"]) -> Float[Array, "*batch"]:
        """The mean of the bin centers under the softmax of the outputs."""
        share = (jax.nn.softmax(outputs) * self.bins.centers[0]).sum(-1)
        return self.value_min + (self.value_max - self.value_min) * share

    def loss(self, outputs: Float[Array, "*batch k"], returns: Float[Array, "*batch"]) -> Float[Array, "*batch"]:
        """The cross-entropy of the outputs with the target of each return, less the target's own entropy.

        Without the entropy, a constant that no gradient sees, 0 is the least that can be.
        """
        share = (returns - self.value_min) / (self.value_max - self.value_min)
        centers = self.bins.centers[0]
        target = self.target(jnp.clip(share, centers[0], centers[-1]))
        own = jnp.where(target > 0, target * jnp.log(jnp.where(target > 0, target, 1.0)), 0.0)
        return (own - target * log_softmax(outputs)).sum(-1)

    @abc.abstractmethod
    def target(self, share: Float[Array, "*batch"]) -> Float[Array, "*batch k"]:
        """The weights of the bins for returns at these places in the support, between the first and last center."""


class HLGaussCritic(Classifier):
    """HL-Gauss (Farebrother et al., 2024, §3.1): the target is a Gaussian histogram of value_eta bin widths."""

    label: ClassVar[str] = "HL-Gauss"

    value_eta: Positive = 0.75
    """The width of the target, in bin widths."""

    def target(self, share: Float[Array, "*batch"]) -> Float[Array, "*batch k"]:
        """The Gaussian's mass in each bin, cut off at the support and rescaled."""
        return targets.hl_gauss(self.bins, share[..., None], self.value_eta)[..., 0, :]


class TwoHotCritic(Classifier):
    """Two-hot (Bellemare et al., 2017, eq. 7): the two centers around a return share the mass, so that they mean it."""

    label: ClassVar[str] = "two-hot"

    def target(self, share: Float[Array, "*batch"]) -> Float[Array, "*batch k"]:
        """1 − distance in bin widths, of the centers that are nearer than a width."""
        return targets.two_hot(self.bins, share[..., None])[..., 0, :]


CRITICS: dict[str, type[Critic]] = {
    "squared-error": SquaredErrorCritic,
    "hl-gauss": HLGaussCritic,
    "two-hot": TwoHotCritic,
}
