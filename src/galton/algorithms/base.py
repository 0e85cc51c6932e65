"""What an algorithm has to offer, and the record in which every static choice of a run is resolved."""

import dataclasses
import functools
from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
from jaxtyping import Array, Float, Key

from galton.critics import Critic
from galton.losses import Loss
from galton.policies import Policy
from galton.types import Config, Hypers, Learner, Rule, Transition

Box = Float[np.ndarray, " d"]
Scalars = dict[str, Float[Array, ""]]
"""What an update tells of itself, by name."""


@dataclasses.dataclass(frozen=True, eq=False)
class Algorithm:
    """An entry of ALGORITHMS: what is done with a rollout. Everything else is any actor-critic's."""

    name: str
    """Its key in ALGORITHMS."""
    label: str
    """Its name in figures and tables."""
    update: Callable[["Agent", Learner, Transition, Hypers, Key[Array, ""]], tuple[Learner, Scalars]]
    """(agent, learner, rollout `[T, N]`, hypers, key of this update alone) → what was learnt, and `scalars`."""
    scalars: tuple[str, ...]
    """The names of what an update tells, means over its minibatches, in the order of the log. One is grad_norm: where
    it is not finite the run has diverged."""
    own: tuple[str, ...] = ()
    """The fields of Config and Hypers that other algorithms have no use for."""
    defaults: Mapping[str, Any] = dataclasses.field(default_factory=dict)
    """Fields of Config and Hypers whose usual value is not that of the records."""
    log_interval: int = 100
    """Updates between two log points of `learn`, unless the caller says otherwise."""
    side_by_side: bool = True
    """Whether a processor core updates many runs at once. Where a single update has large matrix products of its own,
    one run after the other is faster. Other devices always take all at once."""
    choices: tuple[str, ...] = ()
    """The fields of Config that not every algorithm carries out (`credit.CHOICES`), and this one does."""
    check: Callable[[Config], None] = lambda _: None
    """Raise UsageError for a configuration that it can't run."""

    def config(self, **fields: Any) -> Config:
        """A Config with this algorithm's defaults.

        Raises:
            UsageError: a value out of range.
        """
        usual = {name: value for name, value in self.defaults.items() if name not in Hypers._fields}
        return Config(**{**usual, **fields, "algorithm": self.name})

    def hypers(self, **numbers: Any) -> Hypers:
        """Hypers with this algorithm's defaults."""
        usual = {name: value for name, value in self.defaults.items() if name in Hypers._fields}
        return Hypers(**{**usual, **numbers})


@dataclasses.dataclass(frozen=True)
class Agent:
    """The static half of a run: its configuration, with every name in it looked up.

    It is hashable: programs are compiled once for each agent.
    """

    config: Config
    loss: Loss
    make_policy: Callable[[Config, Box, Box], Policy]
    """`create` of the policy's class."""
    make_critic: Callable[[Config], Critic]
    """`create` of the critic's class."""
    algorithm: Algorithm
    low: tuple[float, ...]
    """The action box, in float32."""
    high: tuple[float, ...]

    @functools.cached_property
    def policy(self) -> Policy:
        """The policy for actions in this box."""
        return self.make_policy(self.config, np.array(self.low, np.float32), np.array(self.high, np.float32))

    @functools.cached_property
    def critic(self) -> Critic:
        """How values are read off the critic network, and trained."""
        return self.make_critic(self.config)

    @property
    def scalars(self) -> tuple[str, ...]:
        """The names of what an update tells of itself, in the order of the log."""
        held = ("entropy_share", "entropy_alpha") if self.config.entropy_target else ()
        return (*self.algorithm.scalars, *held)

    def acting_by(self, rule: Rule | None) -> "Agent":
        """The same agent with another deterministic action; None is its own."""
        if rule is None:
            return self
        return dataclasses.replace(self, config=dataclasses.replace(self.config, deterministic_action=rule))
