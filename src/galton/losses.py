"""The losses on one sampled action, to be weighted by its advantage (eqs 4–6).

The whole method is `surrogate`; everything else says which regression or classification it weights.
A new one is a function and a line in LOSSES.
"""

from collections.abc import Callable
from typing import Any, NamedTuple

import jax.numpy as jnp
from jax import lax
from jax.nn import log_softmax
from jaxtyping import Array, Float, Int

from galton import targets
from galton.errors import unknown
from galton.policies.base import Distribution, Family
from galton.policies.histogram import Histogram
from galton.targets import Eta
from galton.types import Hypers


def surrogate(advantage: Float[Array, "*batch"], loss: Float[Array, "*batch"]) -> Float[Array, ""]:
    """The policy gradient as weighted supervised learning (eqs 4–6): mean of advantage · loss, to be minimised."""
    return jnp.mean(lax.stop_gradient(advantage) * loss)


def gaussian(distribution: Distribution, action: Float[Array, "*batch d"], hypers: Hypers) -> Float[Array, "*batch"]:
    """−log π(a): of a Gaussian policy least squares, hidden in the usual policy gradient (eq. 5).

    It fits every policy that has a log-probability; of a histogram it is HL-1-Hot. No number has a part in it.
    """
    del hypers
    return -distribution.log_prob(action)


def hl_one_hot(distribution: Histogram, action: Float[Array, "*batch d"], hypers: Hypers) -> Float[Array, "*batch"]:
    """HL-1-Hot: cross-entropy with all mass on the sampled bin (eq. 6). No number has a part in it."""
    return cross_entropy(distribution, one_hot_target(distribution, action, hypers))


def hl_gauss(distribution: Histogram, action: Float[Array, "*batch d"], hypers: Hypers) -> Float[Array, "*batch"]:
    """HL-Gauss: cross-entropy with a Gaussian histogram around the sampled action (eq. 6)."""
    return cross_entropy(distribution, gaussian_target(distribution, action, hypers))


def hl_gauss_centred(
    distribution: Histogram, action: Float[Array, "*batch d"], hypers: Hypers
) -> Float[Array, "*batch"]:
    """Centred HL-Gauss, ours and not the paper's: the target less the target that the policy itself expects.

    HL-Gauss pulls towards its own smoothing Kᵀπ whenever the baseline is off, because the targets' mean Kᵀπ is
    not π. With q − Kᵀπ as the weights (K: row j is the target of bin j's center) that pull is gone: a constant
    added to the advantage changes nothing on average, and K = I gives HL-1-Hot.
    """
    expected = lax.stop_gradient(expected_target(distribution, hypers.eta))
    return cross_entropy(distribution, gaussian_target(distribution, action, hypers) - expected)


def cross_entropy(distribution: Histogram, weights: Float[Array, "*batch d k"]) -> Float[Array, "*batch"]:
    """−Σ_l Σ_i weights_l(i) log π_l(i); the gradient in the logits is π − weights where these sum to 1 (App. A)."""
    return -(weights * log_softmax(distribution.logits)).sum((-2, -1))


def one_hot_target(
    distribution: Histogram, action: Float[Array, "*batch d"], hypers: Hypers
) -> Float[Array, "*batch d k"]:
    """The target with all mass on the sampled bin."""
    del hypers
    return targets.one_hot(distribution.bins, action)


def gaussian_target(
    distribution: Histogram, action: Float[Array, "*batch d"], hypers: Hypers
) -> Float[Array, "*batch d k"]:
    """A Gaussian histogram of σ = η bin widths around the sampled action."""
    if distribution.samples_centers:
        return _target_of_center(distribution, distribution.bins.encode(action), hypers.eta)
    return targets.hl_gauss(distribution.bins, action, hypers.eta, distribution.choices.target_tails)


def centred_target(
    distribution: Histogram, action: Float[Array, "*batch d"], hypers: Hypers
) -> Float[Array, "*batch d k"]:
    """The Gaussian histogram less HL-Gauss's bias, q − (Kᵀπ − π), which sums to 1.

    At the policy that it was taken from its gradient is that of q − Kᵀπ: π itself adds nothing there. PPO goes on from
    there, where K = I must stay HL-1-Hot; the weights q − Kᵀπ of an earlier policy would not.
    """
    return gaussian_target(distribution, action, hypers) - hl_gauss_bias(distribution, hypers)


def expected_target(distribution: Histogram, eta: Eta) -> Float[Array, "*batch d k"]:
    """Kᵀπ, the mean of HL-Gauss's targets over the policy's own actions; row j of K is the target of bin j's center."""
    bins, tails = distribution.bins, distribution.choices.target_tails
    return targets.mean_of_centers(distribution.probs, eta, tails, bins.bin_centers)


def hl_gauss_bias(distribution: Histogram, hypers: Hypers) -> Float[Array, "*batch d k"]:
    """Kᵀπ − π: what HL-Gauss adds to the mean logit gradient for each unit that the baseline is off."""
    return expected_target(distribution, hypers.eta) - distribution.probs


def _target_of_center(distribution: Histogram, index: Int[Array, "*batch"], eta: Eta) -> Float[Array, "*batch k"]:
    bins = distribution.bins
    return targets.hl_gauss_of_center(bins.n_bins, index, eta, distribution.choices.target_tails, bins.bin_centers)


class Loss(NamedTuple):
    """An entry of LOSSES: what is weighted by the advantage, and which policies it fits."""

    function: Callable[[Any, Array, Hypers], Array]
    """(distribution, action `[*batch, d]`, hypers) → loss `[*batch]`."""
    family: Family
    """Of the policies that it fits: "density" is any, "histogram" those whose distributions are histograms."""
    policy: str
    """The key in POLICIES of the policy that it usually trains."""
    label: str
    """Its name in figures and tables."""
    in_paper: bool = True
    """Whether it is one of the paper's; figures and claims set the others apart."""
    uses: tuple[str, ...] = ()
    """The fields of Hypers that it takes."""
    target: Callable[[Any, Array, Hypers], Array] | None = None
    """Of a cross-entropy: (distribution, action, hypers) → the weights of the bins' log π `[*batch, d, k]`, which PPO
    takes from the policy that sampled; None for other losses."""
    bias: Callable[[Any, Hypers], Array] | None = None
    """(distribution, hypers) → what an error of the baseline adds to the mean logit gradient `[*batch, d, k]`; None:
    nothing."""
    is_wide: bool = False
    """Whether its targets have a width `hypers.eta`, in bins, which may be one number or an array `[*batch, d]`."""


LOSSES = {
    "gaussian": Loss(gaussian, "density", "gaussian", "Gaussian"),
    "hl-one-hot": Loss(hl_one_hot, "histogram", "histogram", "HL-1-Hot", target=one_hot_target),
    "hl-gauss": Loss(
        hl_gauss,
        "histogram",
        "histogram",
        "HL-Gauss",
        uses=("eta",),
        target=gaussian_target,
        bias=hl_gauss_bias,
        is_wide=True,
    ),
    "hl-gauss-centred": Loss(
        hl_gauss_centred,
        "histogram",
        "histogram",
        "Centred HL-Gauss (ours)",
        in_paper=False,
        uses=("eta",),
        target=centred_target,
        is_wide=True,
    ),
}


def find_loss(name: str) -> Loss:
    """The entry of that name; UsageError lists the names if there is none."""
    if name not in LOSSES:
        raise unknown("loss", name, LOSSES)
    return LOSSES[name]
