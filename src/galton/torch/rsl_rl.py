"""The distribution for rsl_rl, under Isaac Lab and MuJoCo Lab: a name in its model's configuration.

"distribution_cfg": {"class_name": "galton.torch.rsl_rl:Histogram", "n_bins": 41, "eta": 2.0}
"""

from typing import Any

import torch
from rsl_rl.modules.distribution import Distribution
from torch import Tensor, nn

from galton.torch import histogram
from galton.torch.initial import Start, initialize_


class Histogram(Distribution):  # type: ignore[misc]
    """A softmax over bins of each action dimension, as rsl_rl's models use distributions.

    Args:
        output_dim: d, the dimensions of actions; the model gives it.
        n_bins: k.
        low: the least action of each dimension, a number or d of them.
        high: the greatest.
        initial_policy: the first policy, as `galton.torch.first_logits` has it.
        initial_std: its width in half-widths of the box.
        words: `loss`, `eta` and the others of `galton.torch.Histogram`.
    """

    def __init__(
        self,
        output_dim: int,
        n_bins: int = 41,
        low: Any = -1.0,
        high: Any = 1.0,
        initial_policy: Start = "clipped-gaussian",
        initial_std: float = 0.6,
        **words: Any,
    ) -> None:
        super().__init__(output_dim)
        self.n_bins, self.initial_policy, self.initial_std = n_bins, initial_policy, initial_std
        self.words = {"low": low, "high": high, "validate_args": False} | words
        self._of(torch.zeros(output_dim, n_bins), validate_args=True)  # raises for what can't be

    def update(self, mlp_output: Tensor) -> None:
        """Take on the logits of a batch, `[N, d, k]`."""
        self._distribution = self._of(mlp_output)

    def sample(self) -> Tensor:
        """Draw actions, `[N, d]`."""
        return self._distribution.sample()

    def deterministic_output(self, mlp_output: Tensor) -> Tensor:
        """The actions without exploration."""
        found: Tensor = self._of(mlp_output).deterministic_sample
        return found

    def as_deterministic_output_module(self) -> nn.Module:
        """The same as a module to export."""
        return _Deterministic(self)

    @property
    def input_dim(self) -> list[int]:
        """Return the shape of the network's output, d and k."""
        return [self.output_dim, self.n_bins]

    @property
    def mean(self) -> Tensor:
        """The mean of each dimension."""
        return self._distribution.mean

    @property
    def std(self) -> Tensor:
        """The standard deviation of each dimension, which is logged."""
        return self._distribution.stddev

    @property
    def entropy(self) -> Tensor:
        """The entropy, summed over dimensions."""
        return self._distribution.entropy()

    @property
    def params(self) -> tuple[Tensor, ...]:
        """Return the logits, which are kept for each step of a rollout."""
        return (self._distribution.logits,)

    def log_prob(self, outputs: Tensor) -> Tensor:
        """The value is log π of actions `[N, d]`, the gradient that of −loss."""
        return self._distribution.log_prob(outputs)

    def kl_divergence(self, old_params: tuple[Tensor, ...], new_params: tuple[Tensor, ...]) -> Tensor:
        """KL(old ‖ new), summed over dimensions; rsl_rl sets its learning rate by it."""
        old, new = (self._of(params[0], head_scale=1.0) for params in (old_params, new_params))
        found: Tensor = torch.distributions.kl_divergence(old, new)
        return found

    def init_mlp_weights(self, mlp: Any) -> None:
        """Set the last layer, so that the first policy is the one that was asked for."""
        words = {name: self.words[name] for name in ("bin_centers", "head_scale") if name in self.words}
        initialize_(mlp[-2], self.n_bins, self.initial_policy, self.initial_std, **words)

    def _of(self, logits: Tensor, **others: Any) -> histogram.Histogram:
        return histogram.Histogram(logits, **self.words | others)


class _Deterministic(nn.Module):
    """The action without exploration of logits `[N, d, k]`, in what torch.jit.script understands."""

    centers: Tensor

    def __init__(self, distribution: Histogram) -> None:
        super().__init__()
        like = distribution._of(torch.zeros(distribution.output_dim, distribution.n_bins))
        self.register_buffer("centers", like.centers)
        self.head_scale, self.is_mean = float(like.head_scale), like.deterministic == "mean"

    def forward(self, mlp_output: Tensor) -> Tensor:
        if self.is_mean:
            mean = (torch.softmax(self.head_scale * mlp_output, -1) * self.centers).sum(-1)
            return torch.clamp(mean, self.centers[:, 0], self.centers[:, -1])
        index = mlp_output.argmax(-1, keepdim=True)
        return self.centers.expand(mlp_output.shape).gather(-1, index)[..., 0]
