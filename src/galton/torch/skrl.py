"""A model of skrl's: a mixin that stands in the place of its GaussianMixin."""

from typing import Any

import torch
from torch import Tensor

from galton.torch.histogram import Histogram


class HistogramMixin:
    """A softmax over bins of each action dimension; `compute` returns logits, `[N, d · k]`.

    Args:
        n_bins: k.
        low: the lower bounds of actions, a number or `[d]`.
        high: the upper bounds.
        role: as skrl has it; unused.
        words: `loss`, `eta` and the others of `galton.torch.Histogram`.
    """

    def __init__(self, *, n_bins: int = 41, low: Any = -1.0, high: Any = 1.0, role: str = "", **words: Any) -> None:
        self._h_n_bins, self._h_words = n_bins, {"low": low, "high": high} | words
        self._h_distribution: Histogram | None = None
        d = max(torch.as_tensor(bound).numel() for bound in (low, high))
        Histogram(torch.zeros(d, n_bins), **self._h_words)  # raises for what can't be

    def act(self, inputs: dict[str, Any], *, role: str = "") -> tuple[Tensor, dict[str, Any]]:
        """Return actions `[N, d]`, and of them, or of those that were taken, `log_prob` `[N, 1]`."""
        net_output, outputs = self.compute(inputs, role)  # type: ignore[attr-defined]
        found = Histogram(net_output.unflatten(-1, (-1, self._h_n_bins)), **self._h_words)
        self._h_distribution = found
        actions = found.sample()
        log_prob = found.log_prob(inputs.get("taken_actions", actions))
        return actions, outputs | {
            "log_prob": log_prob[..., None],
            "mean_actions": found.deterministic_sample,
            "net_output": net_output,
            "stddev": found.stddev,
        }

    def get_entropy(self, *, role: str = "") -> Tensor:
        """The entropy of each row of the last batch, `[N, 1]`."""
        return torch.tensor(0.0) if self._h_distribution is None else self._h_distribution.entropy()[..., None]

    def distribution(self, *, role: str = "") -> Histogram | None:
        """The distribution of the last batch."""
        return self._h_distribution
