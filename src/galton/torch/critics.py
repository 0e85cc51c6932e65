"""Critics that classify: the value is the mean of a softmax over bins, trained by a cross-entropy with returns."""

import math
from typing import Literal, get_args

import torch
from jaxtyping import Float
from torch import Tensor

from galton.errors import require, require_word
from galton.torch.bins import center_shares, exact

Target = Literal["hl-gauss", "two-hot"]


def value_of(logits: Float[Tensor, "*batch k"], low: float, high: float) -> Float[Tensor, "*batch"]:
    """The value that a critic's logits mean: the mean of the bins' centers between low and high."""
    logits = _checked(logits, low, high)
    centers = center_shares(logits.shape[-1], "inside", logits)
    return low + (high - low) * (torch.softmax(logits, -1) * centers).sum(-1)


def classification_loss(
    logits: Float[Tensor, "*batch k"],
    returns: Float[Tensor, "*batch"],
    low: float,
    high: float,
    target: Target = "hl-gauss",
    eta: float = 0.75,
) -> Float[Tensor, "*batch"]:
    """The cross-entropy of a critic's logits with the target of each return, less the target's own entropy.

    Args:
        logits: of k bins of equal width.
        returns: those beyond the first or last center count as that center. No gradient flows into them.
        low: the least return that there is a bin for.
        high: the greatest.
        target: "hl-gauss", a Gaussian of eta bin widths (Farebrother et al., 2024), or "two-hot", whose mean is the
            return (Bellemare et al., 2017, eq. 7).
        eta: the width of the Gaussian.

    Raises:
        UsageError: bounds that are none, returns of another shape, or an unknown target.
    """
    logits = _checked(logits, low, high)
    require_word("target", target, get_args(Target))
    require(0 < eta < math.inf, f"eta is {eta}; the target's width must be finite, and greater than 0")
    fits = returns.shape == logits.shape[:-1]
    require(fits, f"returns have shape {tuple(returns.shape)}; of logits {tuple(logits.shape)} they have all but k")
    k = logits.shape[-1]
    centers = center_shares(k, "inside", logits)
    returns = returns.detach().to(logits.dtype)  # the target is a constant, also where returns are bootstrapped
    share = ((returns - low) / (high - low)).clamp(centers[0], centers[-1])[..., None]
    if target == "two-hot":
        weights = (1 - (centers - share).abs() * k).clamp(min=0)
    else:
        edges = torch.arange(k + 1, dtype=logits.dtype, device=logits.device) / k
        mass = torch.diff(torch.erf((edges - share) * k / (eta * 2**0.5)), dim=-1).clamp(min=0)
        weights = mass / mass.sum(-1, keepdim=True)
    return (torch.special.xlogy(weights, weights) - weights * torch.log_softmax(logits, -1)).sum(-1)


def _checked(logits: Tensor, low: float, high: float) -> Tensor:
    """The logits in float32 or better; UsageError for bins that are none."""
    require(
        -math.inf < low < high < math.inf, f"low is {low} and high {high}; both must be finite, and low the smaller"
    )
    require(logits.shape[-1] > 1, f"logits have shape {tuple(logits.shape)}; they must be [..., k] of 2 bins or more")
    return logits.to(exact(logits))
