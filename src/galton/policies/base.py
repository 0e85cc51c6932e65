"""Policies offer these interfaces. Distributions live inside a traced function; policies are static."""

import abc
from typing import Annotated, Any, ClassVar, Literal, Protocol, TypeVar, runtime_checkable

import numpy as np
from jaxtyping import Array, Bool, Float, Key, PyTree

from galton.errors import require
from galton.fields import Within
from galton.parts import Box, Part, Schedule, settings
from galton.types import Number, Params, Rule

PolicyT = TypeVar("PolicyT", bound="Policy")
Scale = Annotated[Number | None, Within(lambda x: np.isfinite(x) & (x > 0), "finite, and greater than 0")]
EDGE = 0.01
"""Nearer to a bound than this share of the box is at the edge, where a density has no mass on the bound itself."""


def near_edge(self: Any, action: Float[Array, "*batch d"]) -> Bool[Array, "*batch d"]:
    """Return True for entries in the first or last hundredth of the box, or beyond: the first and last of 100 bins."""
    margin = EDGE * (self.high - self.low)
    return (action < self.low + margin) | (action > self.high - margin)


Family = Literal["density", "histogram"]
"""The kind of distribution that a loss needs: one with a log-probability, or one with probabilities of bins besides."""
Marginal = Literal["normal", "uniform"]
"""The distribution of one number of a policy's noise: standard normal, or uniform in [0, 1)."""


@runtime_checkable
class Distribution(Protocol):
    """A distribution of actions in one state, or in each of a batch of states."""

    def sample(self, noise: PyTree[Array]) -> Float[Array, "*batch d"]:
        """An action, from noise that `Policy.noise` drew."""

    def log_prob(self, action: Float[Array, "*batch d"]) -> Float[Array, "*batch"]:
        """The log-probability of an action that `sample` gave, or its log-density, summed over the d dimensions."""

    def deterministic_action(self) -> Float[Array, "*batch d"]:
        """The action taken without exploration."""

    def entropy(self) -> Float[Array, "*batch"]:
        """The entropy in nats, summed over the d independent dimensions."""

    def std(self) -> Float[Array, "*batch d"]:
        """The standard deviation of the action."""

    def at_edge(self, action: Float[Array, "*batch d"]) -> Bool[Array, "*batch d"]:
        """Return True for entries of an action that are as far out as the policy's box lets them be."""


class Policy(Part, abc.ABC):
    """A policy turns network outputs into a distribution of actions in a box. An entry of POLICIES is such a class."""

    family: ClassVar[Family] = "density"
    """A "histogram" policy's distributions are of the class Histogram, which every loss can train; to a "density"
    policy only losses of that family fit."""
    has_kl: ClassVar[bool] = False
    """True if its distributions say how far another one is, as algorithms with a trust region need.

    They have `kl(other)`, KL(self ‖ other) `[*batch]` in nats, and `kl_parts(other)`, by name the parts of it that
    V-MPO bounds one by one: a Gaussian's "mean" and "std", of "bins" kl itself.
    """

    box: Box | None = None
    """The box that actions lie in; a task sets it (`on`)."""
    head_scale: Scale = 1.0
    """The network's outputs are multiplied with this number. Under Adam the policy then moves that many times as far in
    a step as with 1, while the critic and the hidden layers keep their rate."""

    def __post_init__(self) -> None:
        super().__post_init__()
        for name in settings(type(self)):
            value = getattr(self, name)
            endless = isinstance(value, Schedule) and value.is_endless
            require(
                not endless, f"{name} is {value!r}; say over how many steps, for a policy acts outside of training too"
            )

    def on(self: PolicyT, box: Box) -> PolicyT:
        """The policy for actions in this box."""
        return self.replace(box=box)

    @property
    def head(self) -> "Policy":
        """The policy that the settings describe: this one, or the part of it that acts in numbers."""
        return self

    def scaled(self, outputs: Float[Array, "*batch n_outputs"]) -> Float[Array, "*batch n_outputs"]:
        """The network's outputs times `head_scale`, which is what `distribution` takes."""
        return outputs if self.head_scale is None else self.head_scale * outputs

    def head_rates(self, distribution: Any) -> Float[Array, " n_outputs"] | None:
        """The learning rate of the last layer is multiplied by this number for each output; None: it is the others'."""
        return None

    @property
    def low(self) -> Float[np.ndarray, " d"]:
        """The lower bounds of actions."""
        return self._box.arrays()[0]

    @property
    def high(self) -> Float[np.ndarray, " d"]:
        """The upper bounds of actions."""
        return self._box.arrays()[1]

    @property
    def _box(self) -> Box:
        assert self.box is not None, "a policy has no box before `on`"
        return self.box

    @property
    def uniform_entropy(self) -> float:
        """The entropy of the uniform policy, the mean over dimensions, in nats."""
        low, high = self._box[:2]
        return float(np.log(np.subtract(high, low, dtype=np.float64)).mean())

    def acting_by(self: PolicyT, rule: Rule) -> PolicyT:
        """The policy whose deterministic action is this one, or itself where it has no choice, as most densities."""
        own = getattr(self, "deterministic_action", rule)
        return self if rule == own else self.replace(deterministic_action=rule)

    @property
    @abc.abstractmethod
    def n_outputs(self) -> int:
        """Outputs that the actor network must have."""

    @abc.abstractmethod
    def init(self) -> tuple[Float[Array, " n_outputs"], Params]:
        """The outputs are returned that the policy begins with, and its parameters beside the network."""

    @abc.abstractmethod
    def noise(self, key: Key[Array, ""], shape: tuple[int, ...]) -> PyTree[Array]:
        """Draw the noise that `Distribution.sample` needs for a batch of this shape, ahead of the rollout.

        Each leaf begins with the axes of the shape.
        """

    @abc.abstractmethod
    def distribution(self, outputs: Float[Array, "*batch n_outputs"], params: Params) -> Distribution:
        """The distribution that the actor's outputs describe."""


@runtime_checkable
class Sequential(Protocol):
    """A distribution whose dimensions depend on the ones before; an update sees them as independent, given its actions.

    The sum of their log-probabilities is the action's, and the sum of their entropies an unbiased estimate of the
    distribution's where the action was sampled from it.
    """

    def given(self, action: Float[Array, "*batch d"]) -> Distribution:
        """The independent distributions of each dimension after the entries of this action before it."""


@runtime_checkable
class MovesOutputs(Protocol):
    """A policy whose outputs an update sees moved at random; acting, evaluation and the log see them as they are."""

    def moved(self, outputs: Float[Array, "*batch n_outputs"], key: Key[Array, ""]) -> Float[Array, "*batch n_outputs"]:
        """The outputs as an update is to see them this time."""


@runtime_checkable
class Maskable(Protocol):
    """A policy that can leave values out in some states, as the masks of an environment tell."""

    def masked(
        self, outputs: Float[Array, "*batch n_outputs"], mask: Float[Array, "*batch m"]
    ) -> Float[Array, "*batch n_outputs"]:
        """The outputs where a mask forbids some values, which then have no probability."""


@runtime_checkable
class Correlatable(Protocol):
    """A policy whose noise can be correlated in time (`noise_correlation`), since it says how it is distributed."""

    @property
    def noise_marginals(self) -> PyTree[str]:
        """The Marginal of each leaf of `Policy.noise`, in the same structure; a leaf's entries are independent."""
