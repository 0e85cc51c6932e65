"""Critics that classify: the value is the mean of a softmax over bins, trained by a cross-entropy with returns."""

from typing import Literal, get_args

import torch
from jaxtyping import Float
from torch import Tensor

from galton.errors import require, require_word

Target = Literal["hl-gauss", "two-hot"]


def value_of(logits: Float[Tensor, "*batch k"], low: float, high: float) -> Float[Tensor, "*batch"]:
    """The value that a critic's logits mean: the mean of the bins' centers between low and high."""
    return low + (high - low) * (torch.softmax(logits, -1) * _centers(logits)).sum(-1)


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
        returns: those beyond the first or last center count as that center.
        low: the least return that there is a bin for.
        high: the greatest.
        target: "hl-gauss", a Gaussian of eta bin widths (Farebrother et al., 2024), or "two-hot", whose mean is the
            return (Bellemare et al., 2017, eq. 7).
        eta: the width of the Gaussian.

    Raises:
        UsageError: bounds that are none, or an unknown target.
    """
    require(low < high, f"low is {low} and high {high}; low must be the smaller one")
    require_word("target", target, get_args(Target))
    centers, k = _centers(logits), logits.shape[-1]
    share = ((returns - low) / (high - low)).clamp(centers[0], centers[-1])[..., None]
    if target == "two-hot":
        weights = (1 - (centers - share).abs() * k).clamp(min=0)
    else:
        edges = torch.arange(k + 1, dtype=logits.dtype, device=logits.device) / k
        mass = torch.diff(torch.erf((edges - share) * k / (eta * 2**0.5)), dim=-1).clamp(min=0)
        weights = mass / mass.sum(-1, keepdim=True)
    return (torch.special.xlogy(weights, weights) - weights * torch.log_softmax(logits, -1)).sum(-1)


def _centers(logits: Tensor) -> Tensor:
    k = logits.shape[-1]
    return (torch.arange(k, dtype=logits.dtype, device=logits.device) + 0.5) / k
