"""The losses on one sampled action, to be weighted by its advantage (eqs 4–6).

The whole method is `surrogate`; everything else says which regression or classification it weights.
A new one is a function and a line in LOSSES.
"""

from collections.abc import Callable
from typing import Any, NamedTuple

import jax.numpy as jnp
from jax import lax
from jax.nn import log_softmax
from jaxtyping import Array, Float

from galton import targets
from galton.errors import UsageError
from galton.policies.gaussian import Gaussian
from galton.policies.histogram import Histogram
from galton.targets import Eta


def surrogate(advantage: Float[Array, "*batch"], loss: Float[Array, "*batch"]) -> Float[Array, ""]:
    """The policy gradient as weighted supervised learning (eqs 4–6): mean of advantage · loss, to be minimised."""
    return jnp.mean(lax.stop_gradient(advantage) * loss)


def gaussian(distribution: Gaussian, action: Float[Array, "*batch d"], eta: Eta) -> Float[Array, "*batch"]:
    """−log N(a; μ, σ²): least squares, hidden in the usual policy gradient (eq. 5). η has no part in it."""
    del eta
    return -distribution.log_prob(action)


def hl_one_hot(distribution: Histogram, action: Float[Array, "*batch d"], eta: Eta) -> Float[Array, "*batch"]:
    """HL-1-Hot: cross-entropy with all mass on the sampled bin (eq. 6). η has no part in it."""
    del eta
    return cross_entropy(distribution, targets.one_hot(distribution.bins, action))


def hl_gauss(distribution: Histogram, action: Float[Array, "*batch d"], eta: Eta) -> Float[Array, "*batch"]:
    """HL-Gauss: cross-entropy with a Gaussian histogram around the sampled action (eq. 6)."""
    return cross_entropy(distribution, _gaussian_target(distribution, action, eta))


def hl_gauss_centred(distribution: Histogram, action: Float[Array, "*batch d"], eta: Eta) -> Float[Array, "*batch"]:
    """Centred HL-Gauss, ours and not the paper's: the target less the target that the policy itself expects.

    HL-Gauss pulls towards its own smoothing Kᵀπ whenever the baseline is off, because the targets' mean Kᵀπ is
    not π. With q − Kᵀπ as the weights (K: row j is the target of bin j's center) that pull is gone: a constant
    added to the advantage changes nothing on average, and K = I gives HL-1-Hot.
    """
    k = distribution.bins.n_bins
    table = targets.hl_gauss_of_center(k, jnp.arange(k), eta)
    expected = lax.stop_gradient(distribution.probs @ table)
    return cross_entropy(distribution, _gaussian_target(distribution, action, eta) - expected)


def hl_gauss_bias(distribution: Histogram, eta: Eta) -> Float[Array, "*batch d k"]:
    """Kᵀπ − π: what HL-Gauss adds to the mean logit gradient for each unit that the baseline is off."""
    k = distribution.bins.n_bins
    return distribution.probs @ targets.hl_gauss_of_center(k, jnp.arange(k), eta) - distribution.probs


def cross_entropy(distribution: Histogram, weights: Float[Array, "*batch d k"]) -> Float[Array, "*batch"]:
    """−Σ_l Σ_i weights_l(i) log π_l(i); the gradient in the logits is π − weights where these sum to 1 (App. A)."""
    return -(weights * log_softmax(distribution.logits)).sum((-2, -1))


def _gaussian_target(distribution: Histogram, action: Float[Array, "*batch d"], eta: Eta) -> Float[Array, "*batch d k"]:
    bins = distribution.bins
    if distribution.samples_centers:
        return targets.hl_gauss_of_center(bins.n_bins, bins.encode(action), eta)
    return targets.hl_gauss(bins, action, eta)


class Loss(NamedTuple):
    """An entry of LOSSES."""

    function: Callable[[Any, Array, Eta], Array]
    """(distribution, action `[*batch, d]`, eta) → loss `[*batch]`."""
    policy: str
    """The key in POLICIES of the distributions that it is for."""
    label: str
    """Its name in figures and tables."""
    in_paper: bool = True
    uses_eta: bool = False
    bias: Callable[[Any, Eta], Array] | None = None
    """(distribution, eta) → what an error of the baseline adds to the mean logit gradient `[*batch, d, k]`; None: 0."""


LOSSES = {
    "gaussian": Loss(gaussian, "gaussian", "Gaussian"),
    "hl-one-hot": Loss(hl_one_hot, "histogram", "HL-1-Hot"),
    "hl-gauss": Loss(hl_gauss, "histogram", "HL-Gauss", uses_eta=True, bias=hl_gauss_bias),
    "hl-gauss-centred": Loss(hl_gauss_centred, "histogram", "Centred HL-Gauss (ours)", in_paper=False, uses_eta=True),
}


def find_loss(name: str) -> Loss:
    """The entry of that name; UsageError lists the names if there is none."""
    if name not in LOSSES:
        raise UsageError(f"loss is {name!r}; choose from {', '.join(LOSSES)}")
    return LOSSES[name]
