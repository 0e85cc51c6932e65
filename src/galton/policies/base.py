"""What a policy has to offer. Distributions live inside a traced function; policies are static."""

from typing import Protocol, runtime_checkable

from jaxtyping import Array, Bool, Float, Key

from galton.types import Params


@runtime_checkable
class Distribution(Protocol):
    """Of actions in one state, or in a batch of states."""

    def sample(self, noise: Float[Array, "*batch n"]) -> Float[Array, "*batch d"]:
        """An action, from noise that `Policy.noise` drew."""

    def deterministic_action(self) -> Float[Array, "*batch d"]:
        """The action taken without exploration."""

    def entropy(self) -> Float[Array, "*batch"]:
        """In nats, summed over the d independent dimensions."""

    def std(self) -> Float[Array, "*batch d"]:
        """The standard deviation of the action."""

    def at_edge(self, action: Float[Array, "*batch d"]) -> Bool[Array, "*batch d"]:
        """Which entries of an action are as far out as the policy's box lets them be."""


@runtime_checkable
class Policy(Protocol):
    """How network outputs become a distribution over actions in a box."""

    @property
    def n_outputs(self) -> int:
        """Outputs that the actor network must have."""

    def init(self) -> tuple[Float[Array, " n_outputs"], Params]:
        """The initial bias of the actor's last layer, and parameters beside the network."""

    def noise(self, key: Key[Array, ""], shape: tuple[int, ...]) -> Float[Array, "*batch n"]:
        """What `Distribution.sample` needs for a batch of this shape, drawn ahead of the rollout."""

    def distribution(self, outputs: Float[Array, "*batch n_outputs"], params: Params) -> Distribution:
        """The distribution that the actor's outputs describe."""
