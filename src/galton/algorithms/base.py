"""Algorithms have to offer this, and an agent is made of these parts."""

import abc
import math
from collections.abc import Mapping
from typing import Annotated, Any, ClassVar, Literal, TypeVar

import numpy as np
from jaxtyping import Array, Bool, Float, Key, PyTree

from galton.algorithms.credit import CREDITS, Credit
from galton.algorithms.entropy import Entropy, HeldEntropy
from galton.critics import Critic, SquaredErrorCritic
from galton.errors import require
from galton.fields import Within
from galton.losses import LOSSES, HLOneHot, Loss
from galton.networks import MLP, Network
from galton.optimizers import Adam, Optimizer
from galton.parts import Box, Part, settings, trimmed, unusual
from galton.policies import POLICIES, Policy
from galton.policies.correlation import check_correlation
from galton.policies.mixed import MixedPolicy, acting_on
from galton.types import Bonus, Count, Learner, NotNegative, Number, Params, Rule, Share, Transition

AgentT = TypeVar("AgentT", bound="Agent")
AlgorithmT = TypeVar("AlgorithmT", bound="Algorithm")
Scalars = dict[str, Float[Array, ""]]
"""The scalars that an update reports, by name."""
Correlation = Annotated[Number | None, Within(lambda x: (x >= 0) & (x < 1), "0 or more, and less than 1")]
Window = Annotated[Number | None, Within(lambda x: x > 0, "greater than 0, or inf for all that was seen")]


class Rollout(Part):
    """A rollout says how experience is collected, and in what units the learner sees it."""

    n_steps: Count = 20
    """Steps per environment and update."""
    n_envs: Count = 1
    """Copies of the environment that one run steps side by side."""
    normalize_observation: bool = False
    """Standardise observations by running statistics, clipped to ±10."""
    normalize_reward: bool = False
    """Divide rewards by the running standard deviation of the discounted return, clipped to ±10."""
    normalize_window: Window = math.inf
    """The steps, of all environments together, that running statistics count for at most: what was seen before loses
    its weight as exp(−steps since / normalize_window), about. inf: all that was seen counts alike."""
    resets: Literal["fresh", "pool", "first"] = "fresh"
    """The beginnings of episodes in JAX: each in a state of its own, of which n_steps · n_envs are drawn
    for each rollout; in one of reset_pool states that are drawn for it; or where the copy's first episode began. The
    first costs as many resets as steps, the last none."""
    reset_pool: Count = 64
    """States that are drawn for each rollout where episodes begin in one of a pool (resets)."""
    noise_correlation: Correlation = 0.0
    """The correlation of an action's noise with that of the step before, ρ, while an episode lasts; 0: none.
    The noise of each step by itself is distributed as without it."""

    def check_own(self) -> None:
        """Raise UsageError for a pool or a window that nothing uses."""
        unused = self.resets != "pool" and self.reset_pool != Rollout.reset_pool
        require(not unused, f"reset_pool is {self.reset_pool}; it has no use with resets at {self.resets!r}")
        window = "" if self.normalize_observation or self.normalize_reward else unusual(self.normalize_window, math.inf)
        remedy = "it has no use without normalize_observation or normalize_reward"
        require(not window, f"normalize_window is {window}; {remedy}")

    @property
    def size(self) -> int:
        """The steps of one update, those of all environments together."""
        return self.n_steps * self.n_envs


class Algorithm(Part, abc.ABC):
    """An algorithm says what is done with a rollout. An entry of ALGORITHMS is such a class."""

    name: ClassVar[str]
    """Its key in ALGORITHMS."""
    scalars: ClassVar[tuple[str, ...]]
    """The names of what an update tells, means over its minibatches, in the order of the log. One is grad_norm: where
    it is not finite the run has diverged."""
    defaults: ClassVar[Mapping[str, Any]] = {}
    """Settings, its own and other parts', whose usual value is another than their part's."""
    log_interval: ClassVar[int] = 100
    """Updates between two log points of `learn`, unless the caller says otherwise."""
    side_by_side: ClassVar[bool] = True
    """True if a processor core updates many runs at once. Where a single update has large matrix products of its own,
    one run after the other is faster. Other devices always take all at once."""
    choices: ClassVar[tuple[str, ...]] = ()
    """The choices of CARRIED_OUT that it carries out."""

    gamma: Share = 0.99
    """The discount of later rewards, γ."""
    gae_lambda: Share = 1.0
    """λ of GAE; 1 gives n-step returns."""
    vf_coef: NotNegative = 0.5
    """Weight of the critic's loss."""
    ent_coef: Bonus = 0.0
    """Weight of the entropy bonus."""

    def init(self, agent: "Agent", params: Params) -> PyTree[Array]:
        """An algorithm begins with this memory, which is `learner.memory["algorithm"]` from there on."""
        return ()

    @abc.abstractmethod
    def update(
        self, agent: "Agent", learner: Learner, batch: Transition, key: Key[Array, ""]
    ) -> tuple[Learner, Scalars]:
        """Learn from a rollout `[T, N]`, and tell `scalars`; the key is that of this update alone.

        What it remembers stays where the gradient was not finite, as parameters do in `Optimizer.step`.
        """

    def at(self: AlgorithmT, step: Float[Array, ""], frozen: Bool[Array, ""]) -> AlgorithmT:
        """The algorithm of the update at this step, which moves no parameter of a frozen run but by the optimizer."""
        return self

    def check(self, agent: "Agent") -> None:
        """Raise UsageError for an agent that it can't train."""


CARRIED_OUT = ("negative_target", "weighting", "entropy_target")
"""The settings that an algorithm carries out, and not a loss or a policy alone."""


class Agent(Part):
    """All parts of a run. Its numbers may be `[R]`, for R runs; programs are compiled once for each structure."""

    policy: Policy
    """The distribution of actions."""
    loss: Loss
    """The loss that is minimised, weighted by the credit."""
    algorithm: Algorithm
    """The update that is made of a rollout."""
    critic: Critic = SquaredErrorCritic()
    """The way in which values are learnt."""
    credit: Credit = Credit()
    """The weight of each action's loss."""
    entropy: Entropy = Entropy()
    """The hold of the policy's entropy, or none."""
    network: Network = MLP()
    """The network of the actor, and that of the critic."""
    optimizer: Optimizer = Adam()
    """The step that a gradient makes of parameters."""
    rollout: Rollout = Rollout()
    """The experience that is collected for each update."""

    def check_own(self) -> None:
        """Raise UsageError for parts that don't fit together."""
        self._check_shared()
        self._check_loss()
        self._check_choices()
        require(
            not self.credit.normalize_advantage or self.rollout.size > 1,
            "normalize_advantage needs more than one step per update: raise n_steps or n_envs",
        )
        self.critic.check(self.rollout.normalize_reward)
        self.algorithm.check(self)
        check_correlation(self.policy, self.rollout.noise_correlation)

    def _check_shared(self) -> None:
        """Raise UsageError where two parts have a setting of one name and two values: files have one."""
        found: dict[str, tuple[Part, Any]] = {}
        for part in (part for part in vars(self).values() if isinstance(part, Part)):
            for name in settings(type(part)):
                other, value = found.setdefault(name, (part, getattr(part, name)))
                own = getattr(part, name)
                told = f"{name} is {value} in {type(other).__name__}, and {own} in {type(part).__name__}"
                require(bool(np.all(value == own)), f"{told}; give both the same value")

    def _check_loss(self) -> None:
        loss, policy = self.loss, self.policy
        fitting = [name for name, kind in POLICIES.items() if loss.family in ("density", kind.family)]
        require(
            loss.family in ("density", policy.family),
            f"policy is {name_of(policy, POLICIES)!r}, but the loss {name_of(loss, LOSSES)!r} needs a {loss.family}; "
            f"choose from {', '.join(fitting)}",
        )

    def _check_choices(self) -> None:
        """Raise UsageError for what the algorithm does not carry out."""
        negative_target = getattr(self.loss, "negative_target", "same")
        weighting = name_of(self.credit, CREDITS)
        chosen = {
            "negative_target": (negative_target, "same"),
            "weighting": (weighting, "advantage"),
            "entropy_target": (isinstance(self.entropy, HeldEntropy), False),
        }
        for word, (value, usual) in chosen.items():
            told = f"{word} is {value!r}, which algorithm {self.algorithm.name!r} does not carry out"
            require(value == usual or word in self.algorithm.choices, f"{told}; leave it at {usual!r}")
        require(
            negative_target == "same" or self.credit.is_signed,
            f"negative_target is {negative_target!r}, but with weighting {weighting!r} no weight is negative; "
            "choose one of the two",
        )

    def on(self: AgentT, box: Box) -> AgentT:
        """The agent for actions in a box, as programs take it: without a trace of what is off in every run.

        Raises:
            UsageError: a box that the policy can't act in.
        """
        policy = acting_on(self.policy, box)
        told = "entropy_target is True; where a mask forbids actions no share of the box is known: leave it out"
        require(not (box.n_mask and isinstance(self.entropy, HeldEntropy)), told)
        by_likelihood = self.loss.family == "density" or isinstance(self.loss, HLOneHot)
        require(
            by_likelihood or not isinstance(policy, MixedPolicy),
            f"policy is {name_of(self.policy, POLICIES)!r} and loss {name_of(self.loss, LOSSES)!r}, and some actions "
            "are choices; take policy 'histogram', whose bins a wide target can reach, or loss 'hl-one-hot'",
        )
        return trimmed(self.replace(policy=policy))

    @property
    def scalars(self) -> tuple[str, ...]:
        """The names of what an update tells of itself, in the order of the log."""
        return (*self.algorithm.scalars, *self.entropy.scalars)

    @property
    def box(self) -> Box:
        """The box of its actions."""
        assert self.policy.box is not None, "an agent has no box before `on`"
        return self.policy.box

    @property
    def low(self) -> tuple[float, ...]:
        """The lower bounds of its actions, in float32."""
        return self.box.low

    @property
    def high(self) -> tuple[float, ...]:
        """The upper bounds of its actions, in float32."""
        return self.box.high

    def acting_by(self: AgentT, rule: Rule | None) -> AgentT:
        """The same agent with another deterministic action; None is its own."""
        return self if rule is None else self.replace(policy=self.policy.acting_by(rule))


def name_of(part: Part, registry: Mapping[str, type[Part]]) -> str:
    """The name of a part in its registry, or else that of its class."""
    return next((name for name, kind in registry.items() if kind is type(part)), type(part).__name__)
