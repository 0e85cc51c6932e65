"""The records that everything shares. Shapes: T steps, N environments, o observation and d action entries."""

import dataclasses
import math
from collections.abc import Callable
from typing import Any, Literal, NamedTuple

import numpy as np
from jaxtyping import Array, Bool, Float, PyTree

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
    policy: str = "auto"
    """A key of POLICIES; auto is the one that the loss usually trains."""
    algorithm: str = "a2c"
    """A key of ALGORITHMS."""
    n_epochs: int = 10
    """How often PPO goes through a rollout."""
    batch_size: int = 64
    """Steps in each of PPO's minibatches; it divides n_steps · n_envs."""
    ratio: Literal["auto", "smoothed", "true"] = "auto"
    """What PPO clips: the ratio of what the loss measures, or the actions' own likelihood ratio; auto is smoothed for a
    loss with a bias, plain HL-Gauss, and true for all others."""

    def __post_init__(self) -> None:
        for field in dataclasses.fields(self):
            value = getattr(self, field.name)
            if isinstance(field.default, bool):
                fits = isinstance(value, bool | np.bool | int | np.integer) and value in (0, 1)
                require(fits, f"{field.name} is {value!r}; it must be True or False")
                object.__setattr__(self, field.name, bool(value))
            elif isinstance(field.default, int):
                require_integer(field.name, value, 2 if field.name == "n_bins" else 1)
                object.__setattr__(self, field.name, int(value))
            elif isinstance(field.default, str):
                choices = _CHOICES.get(field.name, (value,))
                known = isinstance(value, str) and value in choices
                require(known, f"{field.name} is {value!r}; choose from {', '.join(map(str, choices))}")
        object.__setattr__(self, "net_arch", tuple(self.net_arch))
        for units in self.net_arch:
            require_integer("an entry of net_arch", units, 1)
        require(
            not self.normalize_advantage or self.n_steps * self.n_envs > 1,
            "normalize_advantage needs more than one step per update: raise n_steps or n_envs",
        )


_CHOICES = {
    "initial_policy": ("uniform", "gaussian"),
    "exploration": ("softmax", "gaussian"),
    "bin_sample": ("center", "uniform"),
    "deterministic_action": ("mode", "mean", "median"),
    "ratio": ("auto", "smoothed", "true"),
}


Number = float | Float[Array, "*runs"]
"""One number, or one for each run."""


class Hypers(NamedTuple):
    """Numbers that one compiled program takes as data: scalars, or arrays `[R]` for R runs."""

    learning_rate: Number = 7e-4
    """The step size of Adam, at the start of training."""
    eta: Number = 0.25
    """HL-Gauss's width η = σ / bin width (§4.2)."""
    gamma: Number = 0.99
    """The discount of later rewards, γ."""
    gae_lambda: Number = 1.0
    """λ of GAE; 1 gives n-step returns."""
    vf_coef: Number = 0.5
    """Weight of the critic's loss."""
    ent_coef: Number = 0.0
    """Weight of the entropy bonus."""
    max_grad_norm: Number = 0.5
    """The gradient, actor's and critic's joined, is scaled down to this norm."""
    decay_steps: Number = 0.0
    """The learning rate falls linearly to 0 over so many environment steps; 0: it stays."""
    log_std_init: Number = 0.0
    """The Gaussian's first log σ."""
    log_std_min: Number = -math.inf
    """A floor under the Gaussian's log σ; −inf is none."""
    box_units: Number = 0.0
    """1: the Gaussian's mean and σ are in half-widths of the action box around its center; 0: in the environment's
    own units."""
    clip_range: Number = 0.2
    """PPO clips the likelihood ratio this far from 1."""
    target_kl: Number = math.inf
    """PPO leaves off a rollout once its approximate KL divergence from the sampling policy exceeds 1.5 of this."""


def without_units(hypers: Hypers) -> Hypers:
    """Hypers `[R]` with None for box_units where no run uses them.

    Their program then has no trace of them, and rounds as that of 0.1.0, which had no such units.
    """
    nothing: Any = None
    return hypers if np.any(hypers.box_units) else hypers._replace(box_units=nothing)


def check_hypers(hypers: Hypers) -> None:
    """Raise UsageError where a number is outside the range that means something."""
    for name, value in hypers._asdict().items():
        given = np.asarray(value, np.float64)
        with np.errstate(over="ignore"):
            numbers = given.astype(np.float32)  # what the programs compute with
        right, wanted = _RANGES[name](numbers)
        shown = given[~right].flat[0] if not right.all() else None
        require(shown is None, f"{name} is {shown}; it must be {wanted}")


Range = Callable[[Float[np.ndarray, "*runs"]], tuple[Bool[np.ndarray, "*runs"], str]]
"""Which numbers mean something, and what is wanted, in words."""


def _share(x: Float[np.ndarray, "*runs"]) -> tuple[Bool[np.ndarray, "*runs"], str]:
    return np.asarray((x >= 0) & (x <= 1)), "between 0 and 1"


def _at_least_0(x: Float[np.ndarray, "*runs"]) -> tuple[Bool[np.ndarray, "*runs"], str]:
    return np.asarray(np.isfinite(x) & (x >= 0)), "0 or more"


def _positive(x: Float[np.ndarray, "*runs"]) -> tuple[Bool[np.ndarray, "*runs"], str]:
    return np.asarray(np.isfinite(x) & (x > 0)), "greater than 0"


_RANGES: dict[str, Range] = {
    "learning_rate": _at_least_0,
    "eta": _positive,
    "gamma": _share,
    "gae_lambda": _share,
    "vf_coef": _at_least_0,
    "ent_coef": _at_least_0,
    "max_grad_norm": _positive,
    "decay_steps": _at_least_0,
    "log_std_init": lambda x: (np.isfinite(x), "finite"),
    "log_std_min": lambda x: (x < np.inf, "finite, or -inf for none"),
    "box_units": lambda x: ((x == 0) | (x == 1), "0 or 1"),
    "clip_range": lambda x: (x > 0, "greater than 0"),
    "target_kl": lambda x: (x > 0, "greater than 0, or inf for none"),
}


class Transition(NamedTuple):
    """One step, or with leading axes `[T, N]` a rollout of them."""

    observation: Float[Array, "*batch o"]
    action: Float[Array, "*batch d"]
    """As sampled, before the environment clips it."""
    reward: Float[Array, "*batch"]
    next_observation: Float[Array, "*batch o"]
    """What the step led to, before any reset."""
    terminated: Bool[Array, "*batch"]
    """The task ended: the next state has no value."""
    truncated: Bool[Array, "*batch"]
    """The time limit cut the episode: the next state keeps its value."""


class Learner(NamedTuple):
    """All that a run has learnt, and Adam's memory and the statistics with it."""

    params: Params
    """`actor` and `critic` networks, and for the Gaussian `log_std` `[d]`."""
    optimizer: PyTree[Array]
    """Adam's count of steps and its moments, those shaped like params."""
    normalizer: Any
    """Statistics of observations and rewards, a Normalizer."""
