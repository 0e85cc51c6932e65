"""The records that everything shares. Shapes: T steps, N environments, o observation and d action entries."""

import dataclasses
import math
from typing import Annotated, Any, Literal, NamedTuple

import numpy as np
from jaxtyping import Array, Bool, Float, PyTree

from galton.errors import require
from galton.fields import AtLeast, Within, annotations, check_fields, checked

Params = dict[str, Any]
"""A nested dictionary of arrays."""
Count = Annotated[int, AtLeast(1)]
"""How many of something that there must be."""
Rule = Literal["mode", "mean", "median"]
"""How a softmax policy that does not explore chooses its action."""


@dataclasses.dataclass(frozen=True)
class Config:
    """What changes shapes or code: static, hashable, one compiled program each."""

    loss: str = "hl-gauss"
    """A key of LOSSES."""
    n_bins: Annotated[int, AtLeast(2)] = 100
    """Bins per action dimension, k (§4.1); the Gaussian has none."""
    n_steps: Count = 20
    """Steps per environment and update."""
    n_envs: Count = 1
    """Copies of the environment that one run steps side by side."""
    net_arch: tuple[Count, ...] = (64, 64)
    """Units of the hidden tanh layers, the same for actor and critic; () is linear."""
    initial_policy: Literal["uniform", "gaussian", "clipped-gaussian"] = "uniform"
    """How a softmax policy starts: uniform, like the Gaussian policy inside its box ("Init Gaussian", §5.2.3), or like
    the actions that the environment makes of the Gaussian policy's: clipped, with the tails in the first and last bin.
    log_std_init and box_units say which Gaussian."""
    exploration: Literal["softmax", "gaussian"] = "softmax"
    """What a softmax policy samples from: itself, or the Gaussian with its moments (§5.2.3)."""
    bin_sample: Literal["center", "uniform"] = "center"
    """Which action of a sampled bin is taken: its center (§4.1) or any (footnote 3)."""
    deterministic_action: Rule = "mode"
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
    n_epochs: Count = 10
    """How often PPO goes through a rollout."""
    batch_size: Count = 64
    """Steps in each of PPO's minibatches; it divides n_steps · n_envs."""
    ratio: Literal["auto", "smoothed", "true"] = "auto"
    """What PPO clips: the ratio of what the loss measures, or the actions' own likelihood ratio; auto is smoothed for a
    loss with a bias, plain HL-Gauss, and true for all others."""
    clip_separately: bool = False
    """Scale the gradients of actor and critic down to max_grad_norm each, not the two joined."""
    critic: str = "squared-error"
    """A key of CRITICS."""
    n_value_bins: Annotated[int, AtLeast(2)] = 101
    """Bins of a critic that classifies."""
    bin_centers: Literal["inside", "bounds"] = "inside"
    """Whether all bins are of one width, so that their centers lie inside the box (§4.1), or the first and last center
    are the box's bounds, so that the bins at the ends are half as wide."""
    target_tails: Literal["rescaled", "edges"] = "rescaled"
    """What becomes of an HL-Gauss target's mass beyond the box: the rest is rescaled to sum to 1 (eq. 6), or the first
    and last bin get it."""
    eta_rule: Literal["fixed", "policy"] = "fixed"
    """HL-Gauss's width: η = eta everywhere, or as the policy narrows, per state and dimension:
    η = clip(eta · σ / bin width, eta_min, eta_max) with the policy's standard deviation σ."""
    negative_target: Literal["same", "one-hot"] = "same"
    """HL-Gauss's target for an action with a negative advantage: the same Gaussian, or all mass on its bin."""
    weighting: Literal["advantage", "awr", "v-mpo"] = "advantage"
    """What multiplies the loss: the advantage A, or a positive weight, AWR's exp(A / temperature), at most 20, or
    V-MPO's softmax of A / temperature over the better half of the batch, times its size."""
    entropy_target: bool = False
    """Hold the policy's entropy: a bonus of weight α · std(A) joins the fixed one, and α, of either sign, follows a
    target of the entropy, which goes from entropy_start to entropy_end."""

    def __post_init__(self) -> None:
        check_fields(self)
        require(
            not self.normalize_advantage or self.n_steps * self.n_envs > 1,
            "normalize_advantage needs more than one step per update: raise n_steps or n_envs",
        )

    @property
    def rollout_size(self) -> int:
        """The steps of one update, those of all environments together."""
        return self.n_steps * self.n_envs


def make_config(fields: dict[str, Any]) -> Config:
    """The Config with these fields, in which net_arch may be a list: JSON and TOML know no tuples."""
    arch = fields.get("net_arch")
    return Config(**fields | ({"net_arch": tuple(arch)} if isinstance(arch, list) else {}))


Number = float | Float[Array, "*runs"]
"""One number, or one for each run."""
NotNegative = Annotated[Number, Within(lambda x: np.isfinite(x) & (x >= 0), "finite, and 0 or more")]
Finite = Annotated[Number, Within(np.isfinite, "finite")]
Positive = Annotated[Number, Within(lambda x: np.isfinite(x) & (x > 0), "finite, and greater than 0")]
Share = Annotated[Number, Within(lambda x: (x >= 0) & (x <= 1), "between 0 and 1")]


class Hypers(NamedTuple):
    """Numbers that one compiled program takes as data: scalars, or arrays `[R]` for R runs."""

    learning_rate: NotNegative = 7e-4
    """The step size of Adam, at the start of training."""
    eta: Positive = 0.25
    """HL-Gauss's width η = σ / bin width (§4.2), and that of the smoothed policy. Where the width follows the policy
    (eta_rule) it is the factor of the policy's standard deviation."""
    gamma: Share = 0.99
    """The discount of later rewards, γ."""
    gae_lambda: Share = 1.0
    """λ of GAE; 1 gives n-step returns."""
    vf_coef: NotNegative = 0.5
    """Weight of the critic's loss."""
    ent_coef: NotNegative = 0.0
    """Weight of the entropy bonus."""
    max_grad_norm: Positive = 0.5
    """The gradient, actor's and critic's joined unless clip_separately says otherwise, is scaled down to this norm."""
    decay_steps: Annotated[Number, Within(lambda x: x >= 0, "0 or more, or inf for all steps that are trained")] = 0.0
    """The learning rate falls linearly to 0 over so many environment steps; 0: it stays. inf: over all that are
    trained, which `learn` and `train` know; in each call of `learn` anew."""
    log_std_init: Annotated[Number, Within(np.isfinite, "finite")] = 0.0
    """The Gaussian's first log σ, and that of the policies made of it."""
    log_std_min: Annotated[Number, Within(lambda x: x < np.inf, "finite, or -inf for none")] = -math.inf
    """A floor under the Gaussian's log σ; −inf is none."""
    box_units: Annotated[Number, Within(lambda x: (x == 0) | (x == 1), "0 or 1")] = 0.0
    """1: the Gaussian's mean and σ are in half-widths of the action box around its center; 0: in the environment's
    own units."""
    clip_range: Annotated[Number, Within(lambda x: x > 0, "greater than 0")] = 0.2
    """PPO clips the likelihood ratio this far from 1."""
    target_kl: Annotated[Number, Within(lambda x: x > 0, "greater than 0, or inf for none")] = math.inf
    """PPO leaves off a rollout once its approximate KL divergence from the sampling policy exceeds 1.5 of this."""
    value_min: Annotated[Number, Within(np.isfinite, "finite")] = -10.0
    """The least return that a critic that classifies has a bin for, in the units of the rewards that it sees; with
    normalize_reward that is about one standard deviation of the discounted return."""
    value_max: Annotated[Number, Within(np.isfinite, "finite")] = 10.0
    """The greatest, in the same units."""
    value_eta: Positive = 0.75
    """The HL-Gauss critic's width, in bin widths."""
    noise_correlation: Annotated[Number, Within(lambda x: (x >= 0) & (x < 1), "0 or more, and less than 1")] = 0.0
    """How the noise of an action is correlated with that of the step before, ρ, while an episode lasts; 0: not at all.
    The noise of each step by itself is distributed as without it."""
    rpo_alpha: NotNegative = 0.5
    """How far RPO moves the Gaussian's mean up or down at most where an update looks at it, in the mean's own units."""
    eta_min: Positive = 0.5
    """The least η where the width follows the policy (eta_rule)."""
    eta_max: Positive = 16.0
    """The greatest η where the width follows the policy (eta_rule)."""
    temperature: Positive = 1.0
    """Of positive weights (weighting): the advantage that makes a weight e times as large, in the advantage's units."""
    entropy_start: Positive = 0.5
    """The entropy target at the start, as the share of the box that a uniform policy of that entropy would fill in each
    dimension: e^(H/d) / k for a histogram, e^(h/d) / (high − low) for a density (entropy_target)."""
    entropy_end: Positive = 0.05
    """The entropy target in the end, as such a share."""
    entropy_steps: NotNegative = 500_000.0
    """Environment steps in which the entropy target goes from start to end, linearly in its logarithm; 0: it stays."""
    entropy_rate: Positive = 0.02
    """The step size of what decides α, per gradient step and nat that the entropy of a dimension is off its target."""
    entropy_alpha_min: Annotated[Number, Within(lambda x: np.isfinite(x) & (x <= 0), "finite, and 0 or less")] = -1.0
    """The least α of a held entropy. Below 0 a policy that is wider than its target is narrowed; with 0 the target is a
    floor, above which the policy is left alone."""


def check_config(config: Config) -> None:
    """Raise UsageError for anything but a Config, whose fields were checked when it was made."""
    checked("config", config, Config)


def check_hypers(hypers: Hypers) -> None:
    """Raise UsageError where a field is no number, or outside the range that means something.

    Making a `Hypers` checks nothing, for inside of programs it holds what JAX traces: each way in does it.
    """
    checked("hypers", hypers, Hypers)
    for name, annotation in annotations(Hypers).items():
        checked(name, getattr(hypers, name), annotation)


def check_one_run(hypers: Hypers) -> None:
    """Raise UsageError unless each field is one number, in its range."""
    check_hypers(hypers)
    for name, value in hypers._asdict().items():
        require(np.ndim(value) == 0, f"{name} is {value}; give one number (train alone takes one for each run)")


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
    dual: Float[Array, "*batch"] | tuple[()] = ()
    """The dual variable of the entropy target; () where no entropy is held."""
