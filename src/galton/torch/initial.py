"""The first policy: what the last layer of an actor begins with."""

import math
from typing import Literal, get_args

import torch
from jaxtyping import Float
from torch import Tensor, nn

from galton.errors import require, require_word
from galton.torch import bins

Start = Literal["uniform", "gaussian", "clipped-gaussian"]


def first_logits(
    n_bins: int,
    initial_policy: Start = "clipped-gaussian",
    std: float = 0.6,
    bin_centers: bins.Centers = "bounds",
) -> Float[Tensor, " k"]:
    """The logits of one dimension of a first policy, the same in every state.

    Args:
        n_bins: k.
        initial_policy: "uniform"; "gaussian", whose mass on the centers follows N(0, std²) (§5.2.3); or
            "clipped-gaussian", which has all that lies beyond the box in the first and last bin.
        std: its standard deviation in half-widths of the box, around the middle.
        bin_centers: as the distribution's.

    Raises:
        UsageError: a width that is none, or an unknown word.
    """
    bins.check(n_bins, bin_centers)
    require_word("initial_policy", initial_policy, get_args(Start))
    require(0 < std < math.inf, f"std is {std}; it must be finite, and greater than 0")
    like = torch.zeros((), dtype=torch.float64)
    centers = 2 * bins.center_shares(n_bins, bin_centers, like) - 1
    if initial_policy == "uniform":
        return torch.zeros(n_bins)
    if initial_policy == "gaussian":
        return (-0.5 * (centers / std) ** 2).float()
    inner = (centers[1:] + centers[:-1]) / 2 / std
    return _log_masses(inner).float()


def _log_masses(inner: Tensor) -> Tensor:
    """The logarithms of a normal's masses between these edges and beyond them, from the side that has the digits."""
    edges = torch.cat([inner.new_tensor([-math.inf]), inner, inner.new_tensor([math.inf])])
    low, high = edges[:-1], edges[1:]
    low, high = torch.where(low > 0, -high, low), torch.where(low > 0, -low, high)
    below, above = torch.special.log_ndtr(high), torch.special.log_ndtr(low)
    return below + torch.log1p(-torch.exp(above - below))


@torch.no_grad()
def initialize_(
    layer: nn.Linear,
    n_bins: int,
    initial_policy: Start = "clipped-gaussian",
    std: float = 0.6,
    bin_centers: bins.Centers = "bounds",
    head_scale: float = 1.0,
    gain: float = 0.01,
) -> nn.Linear:
    """Set the last layer of an actor, d · k outputs, so that its first policy is this one in nearly every state.

    Args:
        layer: changed in place, and returned.
        n_bins: k.
        initial_policy: as `first_logits` has it.
        std: the same.
        bin_centers: the same.
        head_scale: as the distribution's, which multiplies the bias too.
        gain: of the orthogonal weights.
    """
    bins.check(n_bins, bin_centers, head_scale=head_scale)
    require(layer.bias is not None, "the layer has no bias, in which the first policy lies; make it with bias=True")
    logits = first_logits(n_bins, initial_policy, std, bin_centers) / head_scale
    fits = layer.out_features % n_bins == 0
    require(fits, f"the layer has {layer.out_features} outputs, which are not d · {n_bins}, whole bins of d dimensions")
    nn.init.orthogonal_(layer.weight, gain)
    layer.bias.copy_(logits.to(layer.bias).repeat(layer.out_features // n_bins))
    return layer
