"""Policies for Stable-Baselines3: its A2C and PPO, and sb3-contrib's TRPO, with a softmax over bins."""

from typing import Any, cast

import torch
from gymnasium.spaces import Box, Dict, Space
from stable_baselines3.common.distributions import CategoricalDistribution
from stable_baselines3.common.policies import ActorCriticPolicy, MultiInputActorCriticPolicy
from stable_baselines3.common.type_aliases import Schedule
from torch import Tensor, nn

from galton.errors import require
from galton.torch import bins
from galton.torch.histogram import Histogram
from galton.torch.initial import Start, first_logits


class HistogramDistribution(CategoricalDistribution):
    """A Histogram as Stable-Baselines3's policies use distributions.

    It is of the class of the one distribution there whose policy needs logits alone.
    """

    def __init__(self, action_space: Box, n_bins: int, **words: Any) -> None:
        super().__init__(int(action_space.shape[0]) * n_bins)
        self.shape = (int(action_space.shape[0]), n_bins)
        self.words = words | {"low": torch.tensor(action_space.low), "high": torch.tensor(action_space.high)}

    def proba_distribution(self, action_logits: Tensor) -> "HistogramDistribution":
        """Take on these logits, `[N, d · k]`."""
        logits = action_logits.reshape(*action_logits.shape[:-1], *self.shape)
        self.distribution: Any = Histogram(logits, **self.words)
        return self

    def mode(self) -> Tensor:
        """The action without exploration."""
        found: Tensor = self.distribution.deterministic_sample
        return found


class _Histograms(ActorCriticPolicy):
    """The policies below have these arguments in common.

    Args:
        args: as Stable-Baselines3's policy has them.
        n_bins: k, the bins of each action dimension.
        loss: as Histogram has it, with the arguments below.
        eta: the width of a Gaussian target, in bins.
        bin_centers: where the first and last center are.
        target_tails: what becomes of a target's mass beyond the box.
        head_scale: the factor of the logits.
        deterministic: the action of `predict(..., deterministic=True)`.
        initial_policy: the first policy, as `first_logits` has it.
        initial_std: its width in half-widths of the box.
        kwargs: as Stable-Baselines3's policy has them.
    """

    def __init__(
        self,
        observation_space: Space[Any],
        action_space: Space[Any],
        lr_schedule: Schedule,
        *args: Any,
        n_bins: int = 41,
        loss: str = "hl-gauss-centred",
        eta: float = 2.0,
        bin_centers: str = "bounds",
        target_tails: str = "reflected",
        head_scale: float = 1.0,
        deterministic: str = "mean",
        initial_policy: Start = "clipped-gaussian",
        initial_std: float = 0.6,
        **kwargs: Any,
    ) -> None:
        fits = isinstance(action_space, Box) and len(action_space.shape) == 1
        require(fits, f"the environment has actions {action_space}; bins are cut into a Box of one axis")
        require(not kwargs.get("use_sde"), "use_sde is True; a softmax has no state-dependent noise: leave it out")
        flat = not isinstance(observation_space, Dict) or isinstance(self, MultiInputActorCriticPolicy)
        require(flat, f"observations are {observation_space}; take MultiInputHistogramPolicy")
        bins.check(n_bins, bin_centers)
        self.bins: dict[str, Any] = {"n_bins": n_bins, "loss": loss, "eta": eta, "bin_centers": bin_centers}
        self.bins |= {"target_tails": target_tails, "head_scale": head_scale, "deterministic": deterministic}
        self.first: dict[str, Any] = {"initial_policy": initial_policy, "initial_std": initial_std}
        super().__init__(observation_space, action_space, lr_schedule, *args, **kwargs)

    def _build(self, lr_schedule: Schedule) -> None:
        made = HistogramDistribution(cast("Box", self.action_space), **self.bins)
        made.proba_distribution(torch.zeros(1, made.action_dim))  # raises for what can't be
        self.action_dist = made
        super()._build(lr_schedule)
        words = self.first["initial_policy"], self.first["initial_std"], self.bins["bin_centers"]
        logits = first_logits(self.bins["n_bins"], *words) / self.bins["head_scale"]
        with torch.no_grad():
            cast("nn.Linear", self.action_net).bias.copy_(logits.repeat(made.shape[0]))

    def _get_constructor_parameters(self) -> dict[str, Any]:
        return super()._get_constructor_parameters() | self.bins | self.first


class HistogramPolicy(_Histograms):
    """MlpPolicy with a softmax over bins: `PPO(HistogramPolicy, env, policy_kwargs={"n_bins": 41})`."""


class MultiInputHistogramPolicy(_Histograms, MultiInputActorCriticPolicy):
    """The same for dictionaries of observations, as MultiInputPolicy."""
