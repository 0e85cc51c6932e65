"""A softmax over bins of each action dimension, whose `log_prob` has the value log π(a) and the gradient of −loss."""

from typing import Any, ClassVar, Literal, get_args

import torch
from jaxtyping import Float
from torch import Tensor
from torch.distributions import Distribution, constraints, register_kl

from galton.errors import UsageError, require, require_word
from galton.torch import bins

Loss = Literal["hl-one-hot", "hl-gauss", "hl-gauss-centred"]
Rule = Literal["mode", "mean"]
Shape = torch.Size | list[int] | tuple[int, ...]
DIVERGED = "logits hold NaN or infinity; the network has diverged: lower its learning rate. Bins can't be masked so"
SLACK = 1e-4
"""An action may lie so far outside of the box, in sizes of the box: rounding, and no mistake."""


class Histogram(Distribution):
    """Π_l softmax(logits_l) over the centers of k bins in each of d action dimensions (§4.1).

    An action is a vector of d numbers, and `log_prob` is the sum over its dimensions, as that of an Independent Normal.
    Its value is log π(a). Its gradient in the logits is that of −loss: so `-advantage * log_prob` is the paper's
    weighted classification (eq. 6), and `exp(log_prob - old_log_prob)` is PPO's true ratio with the loss's gradient.
    Any program that calls `log_prob` trains with these losses, unchanged.

    Args:
        logits: `[..., d, k]`.
        low: the lower bounds of actions, a number or `[d]`.
        high: the upper bounds.
        loss: "hl-one-hot", "hl-gauss" or "hl-gauss-centred"; what it is, galton.losses says.
        eta: the width σ of a Gaussian target, in bins.
        bin_centers: the first and last center are on the "bounds" of the box or "inside" of it.
        target_tails: of a Gaussian target, what becomes of the mass beyond the box: "reflected", "edges" or "rescaled".
        head_scale: the logits are multiplied by this number. Under Adam the policy moves that many times as far a step.
        deterministic: the action without exploration, `deterministic_sample`: the "mean" of the centers, or the "mode".
        validate_args: check logits, actions, and a box of tensors for what they can't be; torch's usual if None.

    Raises:
        UsageError: arguments that make no distribution.
    """

    arg_constraints: ClassVar[dict[str, Any]] = {}
    has_rsample = False

    def __init__(
        self,
        logits: Float[Tensor, "*batch d k"],
        low: object = -1.0,
        high: object = 1.0,
        loss: Loss = "hl-gauss-centred",
        eta: float = 2.0,
        bin_centers: bins.Centers = "bounds",
        target_tails: bins.Tails = "reflected",
        head_scale: float = 1.0,
        deterministic: Rule = "mean",
        validate_args: bool | None = None,
    ) -> None:
        require(logits.ndim >= 2, f"logits have shape {tuple(logits.shape)}; they must be [..., d, k]")
        batch, (d, k) = logits.shape[:-2], map(int, logits.shape[-2:])  # torch.jit traces sizes as tensors
        require_word("loss", loss, get_args(Loss))
        require_word("deterministic", deterministic, get_args(Rule))
        bins.check(k, bin_centers, eta, target_tails, head_scale)
        checked = Distribution._validate_args if validate_args is None else validate_args
        self.low, self.high = bins.box(low, high, logits, checked)
        self.kind, self.eta, self.deterministic = loss, eta, deterministic
        self.bin_centers, self.target_tails, self.head_scale = bin_centers, target_tails, head_scale
        self.logits = logits if head_scale == 1.0 else head_scale * logits.to(bins.exact(logits))
        super().__init__(batch, torch.Size([d]), validate_args=False)
        self._validate_args = checked and not torch.compiler.is_compiling()
        if self._validate_args:
            require(not bins.is_true((~torch.isfinite(logits)).any()), DIVERGED)

    @property
    def n_bins(self) -> int:
        """k, the number of bins in each dimension."""
        return int(self.logits.shape[-1])

    @property
    def support(self) -> constraints.Constraint:
        """Actions in the box."""
        return constraints.independent(constraints.interval(self.low, self.high), 1)

    @property
    def log_probs(self) -> Float[Tensor, "*batch d k"]:
        """The logarithm of each bin's probability; in float32 or better, under autocast too."""
        return torch.log_softmax(self.logits.to(bins.exact(self.logits)), -1)

    @property
    def probs(self) -> Float[Tensor, "*batch d k"]:
        """The probability of each bin."""
        return self.log_probs.exp()

    @property
    def centers(self) -> Float[Tensor, "d k"]:
        """The action that each bin stands for."""
        low, high = self.low[:, None], self.high[:, None]
        share = bins.center_shares(self.n_bins, self.bin_centers, self.low)
        return (low * (1 - share) + high * share).clamp(low, high)  # whose rounding may lie beyond

    @property
    def mean(self) -> Float[Tensor, "*batch d"]:
        """The mean of the centers."""
        return (self.probs * self.centers).sum(-1)

    @property
    def variance(self) -> Float[Tensor, "*batch d"]:
        """The variance of the centers."""
        return (self.probs * (self.centers - self.mean[..., None]) ** 2).sum(-1)

    @property
    def mode(self) -> Float[Tensor, "*batch d"]:
        """The center of the likeliest bin in each dimension."""
        return self._center(self.logits.argmax(-1))

    @property
    def deterministic_sample(self) -> Float[Tensor, "*batch d"]:
        """The action without exploration, by TorchRL's name: as `deterministic` says, `mean` or `mode`."""
        return self.mean.clamp(self.low, self.high) if self.deterministic == "mean" else self.mode

    def sample(self, sample_shape: Shape = torch.Size()) -> Float[Tensor, "*sample d"]:  # noqa: B008
        """Draw actions, each the center of a bin; no gradient flows through them."""
        with torch.no_grad():
            probs = self.probs.expand(*sample_shape, *self.logits.shape)
            try:
                drawn = torch.multinomial(probs.reshape(-1, self.n_bins), 1).reshape(probs.shape[:-1])
            except RuntimeError:
                require(not bins.is_true((~torch.isfinite(self.logits)).any()), DIVERGED)
                raise
            return self._center(drawn)

    def log_prob(self, value: Float[Tensor, "*sample d"]) -> Float[Tensor, "*whole"]:
        """The value is log π of the bins that hold an action, the gradient that of −loss in the logits.

        Raises:
            UsageError: an action outside of the box, where arguments are validated.
        """
        index, log_probs = self._encode(value), self.log_probs
        true = self._of(log_probs, index).sum(-1) + _unknown(value)
        if self.kind == "hl-one-hot":
            return true
        loss = -(self._weights(index, log_probs) * log_probs).sum((-2, -1))
        return true.detach() - (loss - loss.detach())

    def loss(self, value: Float[Tensor, "*batch d"]) -> Float[Tensor, "*batch"]:
        """The loss of each action, for an update of your own: minimise its product with the advantage (eq. 6)."""
        index, log_probs = self._encode(value), self.log_probs
        if self.kind == "hl-one-hot":
            return _unknown(value) - self._of(log_probs, index).sum(-1)
        return _unknown(value) - (self._weights(index, log_probs) * log_probs).sum((-2, -1))

    def entropy(self) -> Float[Tensor, "*batch"]:
        """−Σ_l Σ_i π log π, in nats."""
        log_probs = self.log_probs
        return -(log_probs.exp() * log_probs).sum((-2, -1))

    def expand(self, batch_shape: Shape, _instance: object = None) -> "Histogram":
        """The same distribution for a larger batch."""
        new: Histogram = self._get_checked_instance(Histogram, _instance)  # type: ignore[no-untyped-call]
        vars(new).update({name: value for name, value in vars(self).items() if not name.startswith("_batch")})
        new.logits = self.logits.expand(*batch_shape, *self.logits.shape[-2:])
        super(Histogram, new).__init__(torch.Size(batch_shape), self.event_shape, validate_args=False)
        new._validate_args = self._validate_args
        return new

    def _weights(self, index: Tensor, log_probs: Tensor) -> Tensor:
        """The weights of log π in the loss: the target, less what the policy itself expects where it is centred."""
        kernel = bins.kernel(
            self.n_bins, self.eta, self.target_tails, self.bin_centers, log_probs.dtype, log_probs.device
        )
        target = kernel[index]
        if self.kind == "hl-gauss":
            return target
        with torch.autocast(log_probs.device.type, enabled=False):
            return target - log_probs.detach().exp() @ kernel

    def _encode(self, value: Tensor) -> Tensor:
        fits = value.shape[-1:] == self.event_shape
        require(fits, f"actions have shape {tuple(value.shape)}; they must be [..., d], and d is {self.event_shape[0]}")
        share = (value - self.low) / (self.high - self.low)
        if self._validate_args and not torch.compiler.is_compiling():
            outside = (share < -SLACK) | (share > 1 + SLACK) | torch.isnan(share)
            if bins.is_true(outside.any()):
                raise UsageError(
                    f"an action is {value[outside][0].item()}, outside of the box from {self.low.tolist()} to "
                    f"{self.high.tolist()}; give actions that `sample` drew, or clip them first"
                )
        return bins.encode(share, self.n_bins, self.bin_centers)

    def _center(self, index: Tensor) -> Tensor:
        centers = self.centers.expand(*index.shape, self.n_bins)
        return self._of(centers, index)

    @staticmethod
    def _of(values: Tensor, index: Tensor) -> Tensor:
        """The value of each indexed bin."""
        shape = torch.broadcast_shapes(values.shape[:-1], index.shape)
        return values.expand(*shape, -1).gather(-1, index.expand(shape)[..., None])[..., 0]


def _unknown(value: Tensor) -> Tensor:
    """NaN for actions with a NaN, which are refused only where arguments are validated; 0 for all others."""
    return 0.0 * value.detach().sum(-1)


@register_kl(Histogram, Histogram)  # type: ignore[untyped-decorator]
def _kl(p: Histogram, q: Histogram) -> Tensor:
    """Σ_l Σ_i p (log p − log q); of the same bins."""
    one, other = ((*each.event_shape, each.n_bins, each.bin_centers) for each in (p, q))
    require(one == other, f"one distribution has d, k and bin_centers {one}, and the other {other}")
    if p._validate_args:
        (low, high), (other_low, other_high) = ((each.low.float(), each.high.float()) for each in (p, q))
        apart = bins.is_true((low != other_low).any() | (high != other_high).any())
        require(not apart, "one distribution has other bounds than the other, so their bins are different actions")
    log_p, log_q = p.log_probs, q.log_probs
    return (log_p.exp() * (log_p - log_q)).sum((-2, -1))
