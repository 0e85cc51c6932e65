"""Bins of a box and the targets over them, in torch: the same numbers as galton.bins and galton.targets have."""

import functools
import math
from typing import Any, Literal, get_args

import torch
from jaxtyping import Float, Int
from torch import Tensor

from galton.errors import UsageError, require, require_integer, require_word

Tails = Literal["rescaled", "edges", "reflected"]
Centers = Literal["inside", "bounds"]


def check(n_bins: int, centers: str, eta: float = 1.0, tails: str = "reflected", head_scale: float = 1.0) -> None:
    """Raise UsageError for what no bins or targets can be made of."""
    require_integer("the number of bins", n_bins, 2)
    require_word("bin_centers", centers, get_args(Centers))
    require(0 < eta < math.inf, f"eta is {eta}; the target's width must be finite, and greater than 0")
    require_word("target_tails", tails, get_args(Tails))
    require(0 < head_scale < math.inf, f"head_scale is {head_scale}; it must be finite, and greater than 0")


def exact(logits: Tensor) -> torch.dtype:
    """The type to compute in: that of the logits, but float32 where they have fewer digits, as under autocast."""
    return logits.dtype if logits.dtype in (torch.float32, torch.float64) else torch.float32


def is_true(condition: Tensor) -> bool:
    """The value of a condition; False where nobody can know it, inside of vmap."""
    try:
        return bool(condition)
    except RuntimeError as error:
        if "vmap" not in str(error):
            raise
        return False


def box(
    low: object, high: object, logits: Float[Tensor, "*batch d k"], validate: bool
) -> tuple[Float[Tensor, " d"], Float[Tensor, " d"]]:
    """Both bounds as tensors `[d]`, on the logits' device; UsageError for a box that can't be cut into bins.

    Numbers are always checked, and tensors in this machine's memory. Others are where arguments are validated.
    """
    d, bounds = logits.shape[-2], []
    for name, bound in (("low", low), ("high", high)):
        try:
            given = bound if isinstance(bound, Tensor) else torch.as_tensor(bound, dtype=torch.float64)
        except (TypeError, ValueError, RuntimeError):
            raise UsageError(f"{name} is {bound!r}; it must be a number, or one for each of {d} dimensions") from None
        fits = given.ndim == 0 or tuple(given.shape) == (d,)
        require(fits, f"{name} has shape {tuple(given.shape)}; the logits [..., d, k] have d = {d} dimensions")
        bounds.append(given.expand(d))
    if not torch.compiler.is_compiling() and (validate or _is_here(low) or _is_here(high)):
        _check_box(bounds[0].cpu(), bounds[1].cpu(), logits)
    first, last = (bound.to(exact(logits)).to(logits.device) for bound in bounds)
    return first, last


def _is_here(bound: object) -> bool:
    return not isinstance(bound, Tensor) or (type(bound) is Tensor and bound.device.type == "cpu")


def _check_box(low: Float[Tensor, " d"], high: Float[Tensor, " d"], logits: Float[Tensor, "*batch d k"]) -> None:
    infinite = is_true((~(torch.isfinite(low) & torch.isfinite(high))).any())
    if infinite or is_true((low >= high).any()):
        remedy = "bins need finite bounds: scale the actions into a box first"
        raise UsageError(
            f"low is {low.tolist()} and high {high.tolist()}; "
            + (remedy if infinite else "each low must lie below its high")
        )
    n_bins, dtype = logits.shape[-1], exact(logits)
    spacing = torch.finfo(dtype).eps * torch.maximum(low.abs(), high.abs()).double()
    if is_true(((high.double() - low.double()) / n_bins <= 4 * spacing).any()):
        raise UsageError(
            f"low is {low.tolist()} and high {high.tolist()}; {n_bins} bins between them are too narrow for "
            f"{str(dtype).removeprefix('torch.')}; take fewer bins or shift the box"
        )


def center_shares(n_bins: int, centers: Centers, like: Tensor) -> Float[Tensor, " k"]:
    """The bins' centers in a box from 0 to 1."""
    steps = torch.arange(n_bins, dtype=torch.float64)
    shares = steps / (n_bins - 1) if centers == "bounds" else (steps + 0.5) / n_bins
    return shares.to(like.device, like.dtype)


def encode(share: Float[Tensor, "*batch d"], n_bins: int, centers: Centers) -> Int[Tensor, "*batch d"]:
    """The bin that holds each action, which is told as its place in a box from 0 to 1; on an edge by rounding.

    NaN is in the first bin, for an index out of range would end a program on a GPU.
    """
    place = share * (n_bins - 1) + 0.5 if centers == "bounds" else share * n_bins
    return place.nan_to_num(0.0).floor().clamp(0, n_bins - 1).long()


def _kernel(
    n_bins: int, eta: float, tails: Tails, centers: Centers, dtype: torch.dtype, device: torch.device
) -> Float[Tensor, "k k"]:
    index = torch.arange(n_bins, dtype=torch.float64)
    if tails == "reflected":
        there, back = index - index[:, None], index + index[:, None] + 1
        return (_folded(n_bins, there, eta) + _folded(n_bins, back, eta)).to(device, dtype)
    scale = eta * math.sqrt(2)
    ends = 0.5 if centers == "inside" else 0.0
    inner = torch.erf((index[1:] - 0.5 - index[:, None]) / scale)
    low, high = -torch.ones(n_bins, 1, dtype=torch.float64), torch.ones(n_bins, 1, dtype=torch.float64)
    if tails == "rescaled":
        low, high = torch.erf(-(index[:, None] + ends) / scale), torch.erf((n_bins - 1 + ends - index[:, None]) / scale)
    mass = torch.diff(torch.cat([low, inner, high], 1), dim=1)
    return (mass / (high - low)).to(device, dtype)


def _folded(n_bins: int, step: Tensor, eta: float) -> Tensor:
    """The mass of a bin so many steps away, of three rounds of 2k bins; of a wide Gaussian by its Fourier series."""
    period = 2 * n_bins
    step = (step + n_bins) % period - n_bins
    if eta > n_bins / 3:
        waves = math.pi * torch.arange(1, 9, dtype=step.dtype) / n_bins
        heights = torch.exp(-((waves * eta) ** 2) / 2) * torch.sinc(waves / (2 * math.pi))
        return (0.5 + (heights * torch.cos(waves * step[..., None])).sum(-1)) / n_bins
    scale = eta * math.sqrt(2)
    rounds = [
        torch.erf((step + 0.5 + m * period) / scale) - torch.erf((step - 0.5 + m * period) / scale) for m in (-1, 0, 1)
    ]
    return sum(rounds, torch.zeros_like(step)) / 2


@functools.lru_cache(maxsize=64)
def _cached(*arguments: Any) -> Float[Tensor, "k k"]:
    with torch.inference_mode(False):  # what is made in that mode could not be used in training
        return _kernel(*arguments)


def kernel(
    n_bins: int, eta: float, tails: Tails, centers: Centers, dtype: torch.dtype, device: torch.device
) -> Float[Tensor, "k k"]:
    """K, whose row j is HL-Gauss's target for an action in the center of bin j (§2.3, §4.2).

    Args:
        n_bins: k.
        eta: the target's standard deviation in bin widths.
        tails: the mass beyond the box is rescaled, left in the first and last bin ("edges"), or folded back.
        centers: the first and last center are inside the box or on its bounds.
        dtype: of the result, which is computed in float64.
        device: of the result.
    """
    traced = torch.compiler.is_compiling() or torch.jit.is_tracing()  # type: ignore[attr-defined, no-untyped-call]
    make = _kernel if traced else _cached
    return make(n_bins, eta, tails, centers, dtype, device)
