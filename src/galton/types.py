"""The records that everything shares. Shapes: T steps, N environments, o observation and d action entries."""

import dataclasses
from typing import Any, Literal, NamedTuple

import numpy as np
from jaxtyping import Array, Bool, Float, Int, PyTree

from galton.errors import require, require_integer

Params = dict[str, Any]
"""A nested dictionary of arrays."""


@dataclasses.dataclass(frozen=True)
class Config:
    """What changes shapes or code: static, hashable, one compiled program each."""

    loss: str = "hl-gauss"
    """A key of LOSSES."""
    n_bins: int = 100
    """Bins per action dimension, k (§4.1); the Gaussian has none."""
    n_steps: int = 20
    """Steps per environment and update."""
    n_envs: int = 1
    """Copies of the environment that one run steps side by side."""
    net_arch: tuple[int, ...] = (64, 64)
    """Units of the hidden tanh layers, the same for actor and critic; () is linear."""
    initial_policy: Literal["uniform", "gaussian"] = "uniform"
    """How a softmax policy starts: uniform, or like the Gaussian policy ("Init Gaussian", §5.2.3)."""
    exploration: Literal["softmax", "gaussian"] = "softmax"
    """What a softmax policy samples from: itself, or the Gaussian with its moments (§5.2.3)."""
    bin_sample: Literal["center", "uniform"] = "center"
    """Which action of a sampled bin is taken: its center (§4.1) or any (footnote 3)."""
    deterministic_action: Literal["mode", "mean", "median"] = "mode"
    """The action of a softmax policy that does not explore."""
    normalize_advantage: bool = False
    """Standardise the advantages of each batch."""
    normalize_observation: bool = False
    """Standardise observations by running statistics, clipped to ±10."""
    normalize_reward: bool = False
    """Divide rewards by the running standard deviation of the discounted return, clipped to ±10."""

    def __post_init__(self) -> None:
        require_integer("n_bins", self.n_bins, 2)
        require_integer("n_steps", self.n_steps, 1)
        require_integer("n_envs", self.n_envs, 1)
        object.__setattr__(self, "net_arch", tuple(self.net_arch))
        for units in self.net_arch:
            require_integer("an entry of net_arch", units, 1)
        for field, choices in _CHOICES.items():
            value = getattr(self, field)
            require(value in choices, f"{field} is {value!r}; choose from {', '.join(choices)}")
        require(
            not self.normalize_advantage or self.n_steps * self.n_envs > 1,
            "normalize_advantage needs more than one step per update: raise n_steps or n_envs",
        )


_CHOICES = {
    "initial_policy": ("uniform", "gaussian"),
    "exploration": ("softmax", "gaussian"),
    "bin_sample": ("center", "uniform"),
    "deterministic_action": ("mode", "mean", "median"),
}


Number = float | Float[Array, "*runs"]
"""One number, or one for each run."""


class Hypers(NamedTuple):
    """Numbers that one compiled program takes as data: scalars, or arrays `[R]` for R runs."""

    learning_rate: Number = 7e-4
    """Adam's step size."""
    eta: Number = 0.25
    """HL-Gauss's width η = σ / bin width (§4.2)."""
    gamma: Number = 0.99
    """Discount."""
    gae_lambda: Number = 1.0
    """λ of GAE; 1 gives n-step returns."""
    vf_coef: Number = 0.5
    """Weight of the critic's loss."""
    ent_coef: Number = 0.0
    """Weight of the entropy bonus."""
    max_grad_norm: Number = 0.5
    """The gradient, actor's and critic's joined, is scaled down to this norm."""


def check_hypers(hypers: Hypers) -> None:
    """Raise UsageError where a number is outside the range that means something."""
    at_least_zero = ("learning_rate", "vf_coef", "ent_coef")
    for name, value in hypers._asdict().items():
        given = np.asarray(value, np.float64)
        with np.errstate(over="ignore"):
            numbers = given.astype(np.float32)  # what the programs compute with
        finite = np.isfinite(numbers)
        if name in ("gamma", "gae_lambda"):
            right, wanted = finite & (numbers >= 0) & (numbers <= 1), "between 0 and 1"
        elif name in at_least_zero:
            right, wanted = finite & (numbers >= 0), "0 or more"
        else:
            right, wanted = finite & (numbers > 0), "greater than 0"
        shown = given[~right].flat[0] if not right.all() else None
        require(shown is None, f"{name} is {shown}; it must be {wanted}")


class Transition(NamedTuple):
    """One step, or with leading axes `[T, N]` a rollout of them."""

    observation: Float[Array, "*batch o"]
    action: Float[Array, "*batch d"]
    """As sampled, before the environment clips it."""
    reward: Float[Array, "*batch"]
    next_observation: Float[Array, "*batch o"]
    """Before any reset."""
    terminated: Bool[Array, "*batch"]
    """The task ended: the next state has no value."""
    truncated: Bool[Array, "*batch"]
    """The time limit cut the episode: the next state keeps its value."""


class Learner(NamedTuple):
    """All that a run has learnt."""

    params: Params
    """`actor` and `critic` networks, and for the Gaussian `log_std` `[d]`."""
    optimizer: PyTree[Array]
    """Adam's moments, shaped like params."""
    normalizer: Any
    """Statistics of observations and rewards, a Normalizer."""


class EpisodeState(NamedTuple):
    """N environments in the middle of their episodes."""

    env: PyTree[Array]
    """The environments' own states, each leaf `[N, ...]`."""
    length: Int[Array, " N"]
    """Steps taken in this episode."""
    undiscounted_return: Float[Array, " N"]
    """Reward collected in this episode."""
