"""The losses on one sampled action, to be weighted by its advantage (eqs 4–6).

The whole method is `surrogate`; everything else says which regression or classification it weights. `as_log_prob` is
for programs of others.
A new one is a class of this kind, with the settings that it needs, and a line in LOSSES.
"""

import abc
from typing import Any, ClassVar, Literal

import jax.numpy as jnp
import numpy as np
from jax import lax
from jax.nn import log_softmax
from jaxtyping import Array, Float

from galton import kernels
from galton.bins import UnevenBins
from galton.errors import require, require_word
from galton.kernels import Weights
from galton.parts import Part, unusual
from galton.policies.base import Distribution, Family, Sequential
from galton.policies.histogram import Histogram
from galton.policies.mixed import Mixed
from galton.targets import Eta, Tails
from galton.types import Bonus, Positive

Losses = Float[Array, "*batch"]


def surrogate(advantage: Float[Array, "*batch"], loss: Losses) -> Float[Array, ""]:
    """The policy gradient as weighted supervised learning (eqs 4–6): mean of advantage · loss, to be minimised."""
    return jnp.mean(lax.stop_gradient(advantage) * loss)


def cross_entropy(distribution: Histogram, weights: Weights) -> Losses:
    """−Σ_l Σ_i weights_l(i) log π_l(i); the gradient in the logits is π − weights where these sum to 1 (App. A)."""
    return -(weights * log_softmax(distribution.logits)).sum((-2, -1))


class Loss(Part, abc.ABC):
    """A loss gives each action the number that the advantage weights. An entry of LOSSES is a class of this kind."""

    family: ClassVar[Family] = "density"
    """Of the policies that it fits: "density" is any, "histogram" those whose distributions are histograms."""
    policy: ClassVar[str] = "gaussian"
    """The key in POLICIES of the policy that it usually trains."""
    in_paper: ClassVar[bool] = False
    """True for a loss of the paper's; figures and claims set the others apart."""

    is_biased: ClassVar[bool] = False
    """True if an error of the baseline adds something to the mean logit gradient: `bias`."""

    @abc.abstractmethod
    def __call__(self, distribution: Any, action: Float[Array, "*batch d"]) -> Losses:
        """The loss of each action."""

    def target(self, distribution: Any, action: Float[Array, "*batch d"]) -> Weights | None:
        """The weights of a cross-entropy; None for other losses.

        PPO's smoothed ratio and TRPO take them from the policy that sampled.
        """

    def bias(self, distribution: Any) -> Weights | float:
        """Return what an error of the baseline adds to the mean logit gradient, for each unit that it is off."""
        return 0.0

    def of_negatives(self, distribution: Any, action: Float[Array, "*batch d"]) -> Losses | None:
        """The losses of actions with a negative weight, where they are other ones; None where they are the same."""

    def regularizer(self, distribution: Any) -> Losses | None:
        """The objective has this term for each state beside the weighted losses; None is no term."""


class NegativeLogLikelihood(Loss):
    """−log π(a): of a Gaussian policy least squares, hidden in the usual policy gradient (eq. 5).

    It fits every policy that has a log-probability; of a histogram it is HL-1-Hot.
    """

    label: ClassVar[str] = "Gaussian"
    in_paper: ClassVar[bool] = True

    def __call__(self, distribution: Distribution, action: Float[Array, "*batch d"]) -> Losses:
        """The negative log-probability of each action, or its negative log-density."""
        return -distribution.log_prob(action)


class HLOneHot(Loss):
    """HL-1-Hot: cross-entropy with all mass on the sampled bin (eq. 6)."""

    family: ClassVar[Family] = "histogram"
    policy: ClassVar[str] = "histogram"
    label: ClassVar[str] = "HL-1-Hot"
    in_paper: ClassVar[bool] = True

    def __call__(self, distribution: Histogram | Mixed, action: Float[Array, "*batch d"]) -> Losses:
        """The cross-entropy with the one-hot target: −log π of each action's bins."""
        return -distribution.log_prob_of_bins(action)


class HLGauss(Loss):
    """HL-Gauss: cross-entropy with a Gaussian histogram around the sampled action (eq. 6)."""

    family: ClassVar[Family] = "histogram"
    policy: ClassVar[str] = "histogram"
    label: ClassVar[str] = "HL-Gauss"
    in_paper: ClassVar[bool] = True
    is_biased: ClassVar[bool] = True

    eta: Positive = 0.25
    """The width η = σ / bin width (§4.2). Where it follows the policy (eta_rule) this is the factor of the policy's
    standard deviation."""
    target_tails: Tails = "rescaled"
    """Target mass beyond the box: the rest is rescaled to sum to 1 (eq. 6), the first and last bin get it, or it is
    folded back."""
    eta_rule: Literal["fixed", "policy"] = "fixed"
    """The width: η = eta everywhere, or as the policy narrows, per state and dimension:
    η = clip(eta · σ / bin width, eta_min, eta_max) with the policy's standard deviation σ."""
    eta_min: Positive = 0.5
    """The least η where the width follows the policy."""
    eta_max: Positive = 16.0
    """The greatest η where the width follows the policy."""
    negative_target: Literal["same", "one-hot"] = "same"
    """The target for an action with a negative weight: the same Gaussian, or all mass on its bin."""
    diffusion: Bonus = 0.0
    """The weight β of a bonus that moves the logits along Kᵀπ − π, whatever the actions are worth: probability spreads
    to neighbouring bins, so that no policy becomes certain (0: none)."""

    def __call__(self, distribution: Histogram, action: Float[Array, "*batch d"]) -> Losses:
        """The cross-entropy with the Gaussian target."""
        return cross_entropy(distribution, self.target(distribution, action))

    def target(self, distribution: Histogram, action: Float[Array, "*batch d"]) -> Weights:
        """A Gaussian histogram of σ = η bin widths around the action, or its bin's center where centers are sampled."""
        eta = self.width(distribution)
        return kernels.of_action(distribution.bins, distribution, action, eta, self.target_tails)

    def check_own(self) -> None:
        """Raise UsageError for bounds of the width that are none, or that nothing uses."""
        for name in ("eta_min", "eta_max") if self.eta_rule == "fixed" else ():
            other = unusual(getattr(self, name), getattr(HLGauss, name))
            require(not other, f"{name} is {other}; it has no use with eta_rule at 'fixed'")
        require(
            bool(np.all(np.asarray(self.eta_min) <= np.asarray(self.eta_max))),
            f"eta_min is {self.eta_min} and eta_max {self.eta_max}; eta_min must be the smaller",
        )

    def bias(self, distribution: Histogram) -> Weights | float:
        """Kᵀπ − π, where a Gaussian target pulls the policy, whatever the action is worth."""
        return self.expected_target(distribution) - distribution.probs

    def of_negatives(self, distribution: Histogram, action: Float[Array, "*batch d"]) -> Losses | None:
        """The losses of HL-1-Hot, where negative weights have its target."""
        return None if self.negative_target == "same" else HLOneHot()(distribution, action)

    def regularizer(self, distribution: Histogram) -> Losses | None:
        """−β Σ_l Σ_i (Kᵀπ)_i log π_i with Kᵀπ held fixed, whose gradient in the logits is β (π − Kᵀπ).

        It is fixed share (Herbster & Warmuth, 1998) with a local kernel. An entropy bonus leaves a policy alone that is
        certain already; this one does not.
        """
        if self.diffusion is None or (isinstance(self.diffusion, int | float) and self.diffusion == 0):
            return None
        return self.diffusion * cross_entropy(distribution, lax.stop_gradient(self.expected_target(distribution)))

    def width(self, distribution: Histogram) -> Eta:
        """The η that these distributions call for; `[*batch, d]` where it follows the policy.

        It is `[d]` where entries have widths of their own. No gradient flows through it.
        """
        bins, eta = distribution.bins, self.eta
        if isinstance(bins, UnevenBins) and bins.etas is not None:
            eta = jnp.where(np.isnan(bins.etas), eta, bins.etas)
        if self.eta_rule == "fixed":
            return eta
        return jnp.clip(eta * lax.stop_gradient(distribution.std()) / bins.width, self.eta_min, self.eta_max)

    def expected_target(self, distribution: Histogram) -> Weights:
        """Kᵀπ, the mean of the targets over the policy's own actions; row j of K is the target of bin j's center."""
        return kernels.expected(distribution.bins, distribution, self.width(distribution), self.target_tails)


class HLGaussCentred(HLGauss):
    """Centred HL-Gauss, ours and not the paper's: the target less the target that the policy itself expects.

    HL-Gauss pulls towards its own smoothing Kᵀπ whenever the baseline is off, because the targets' mean Kᵀπ is
    not π. With q − Kᵀπ as the weights (K: row j is the target of bin j's center) that pull is gone: a constant
    added to the advantage changes nothing on average, as long as actions are bin centers, and K = I gives HL-1-Hot.
    """

    label: ClassVar[str] = "Centred HL-Gauss (ours)"
    in_paper: ClassVar[bool] = False
    is_biased: ClassVar[bool] = False

    def __call__(self, distribution: Histogram, action: Float[Array, "*batch d"]) -> Losses:
        """The cross-entropy with the centred weights."""
        expected = lax.stop_gradient(self.expected_target(distribution))
        return cross_entropy(distribution, super().target(distribution, action) - expected)

    def target(self, distribution: Histogram, action: Float[Array, "*batch d"]) -> Weights:
        """The Gaussian histogram less HL-Gauss's bias, q − (Kᵀπ − π), which sums to 1.

        At the policy that it was taken from its gradient is that of q − Kᵀπ: π itself adds nothing there. PPO goes on
        from there, where K = I must stay HL-1-Hot; the weights q − Kᵀπ of an earlier policy would not.
        """
        return super().target(distribution, action) - super().bias(distribution)

    def bias(self, distribution: Histogram) -> Weights | float:
        """Nothing: centring takes it away."""
        return 0.0


def as_log_prob(loss: Loss, distribution: Distribution, action: Float[Array, "*batch d"]) -> Float[Array, "*batch"]:
    """A number for each action with the value log π(a) and the gradient of −loss.

    A program that calls `log_prob` trains with the loss where this stands in its place: −A · log_prob is the weighted
    loss of eqs 4–6, and exp(log_prob − old) is PPO's true ratio with the loss's gradient. `galton.torch.Histogram` has
    the same for PyTorch.

    Raises:
        UsageError: a loss that is not all of its objective: `negative_target` and `diffusion` are beside it.
    """
    given = distribution.given(action) if isinstance(distribution, Sequential) else distribution
    require(
        loss.of_negatives(given, action) is None and loss.regularizer(given) is None,
        f"loss is {loss}; a log-probability can't have its negative_target or diffusion: leave them out, or add "
        "loss.of_negatives and loss.regularizer to the objective",
    )
    own = loss(given, action)
    found: Losses = lax.stop_gradient(distribution.log_prob(action)) - (own - lax.stop_gradient(own))
    return found


LOSSES: dict[str, type[Loss]] = {
    "gaussian": NegativeLogLikelihood,
    "hl-one-hot": HLOneHot,
    "hl-gauss": HLGauss,
    "hl-gauss-centred": HLGaussCentred,
}


def find_loss(name: str) -> type[Loss]:
    """The entry of that name; UsageError lists the names if there is none."""
    require_word("loss", name, LOSSES)
    return LOSSES[name]
