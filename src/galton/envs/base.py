"""An environment in pure JAX has to offer this."""

from typing import Protocol, runtime_checkable

import numpy as np
from jaxtyping import Array, Bool, Float, Key, PyTree


@runtime_checkable
class Environment(Protocol):
    """A task as pure functions of one state; constants are fields of a frozen record.

    The randomness of a step is drawn ahead by `noise`, so that `step` is deterministic: s' = f(s, a, w). Episodes
    end when `step` terminates or after `max_episode_steps`, which the caller counts. Actions arrive clipped into
    the box.

    Four more members are optional:

    - `action_space`, a space of Gymnasium's, stands in the place of the box; `step` then gets an action of its
      structure, whose integers are int32.
    - `action_mask(state)` says which values of choices are allowed in a state, 1 for each that is: at least one of each
      choice.
    - `metrics(state)` is a dictionary of numbers about the state that a step led to, such as whether the goal is
      reached. The log has their means over all steps since the last point, as `env_` and the name.
    - `carried(ended, fresh)` is the state in which the next episode begins, of the state in which one has ended and of
      one that `reset` made: for a task with something that outlasts episodes, as `galton.envs.DriftingBandit`'s clock.
      Evaluation begins with what training's copies have come to.
    """

    @property
    def action_low(self) -> Float[np.ndarray, " d"]:
        """Lower bounds of the action box."""

    @property
    def action_high(self) -> Float[np.ndarray, " d"]:
        """Upper bounds of the action box."""

    @property
    def observation_low(self) -> Float[np.ndarray, " o"]:
        """Lower bounds of the observations."""

    @property
    def observation_high(self) -> Float[np.ndarray, " o"]:
        """Upper bounds of the observations."""

    @property
    def max_episode_steps(self) -> int:
        """After how many steps an episode is cut off."""

    @property
    def optimal_return(self) -> float | None:
        """The best expected undiscounted return, where it is known."""

    @property
    def random_return(self) -> float | None:
        """The expected undiscounted return of uniformly random actions, where it is known."""

    def reset(self, key: Key[Array, ""]) -> PyTree[Array]:
        """A first state: any pytree of arrays."""

    def noise(self, key: Key[Array, ""]) -> PyTree[Array]:
        """The randomness of one step; () for a deterministic task."""

    def step(
        self, state: PyTree[Array], action: Float[Array, " d"], noise: PyTree[Array]
    ) -> tuple[PyTree[Array], Float[Array, ""], Bool[Array, ""]]:
        """The next state, the reward and whether the task ended."""

    def __hash__(self) -> int:
        """Programs are compiled once per record."""

    def observe(self, state: PyTree[Array]) -> Float[Array, " o"]:
        """The observation that the agent has of a state."""


def missing(record: object) -> list[str]:
    """The members of Environment that something lacks; an `action_space` stands for the bounds of a box."""
    members = [name for name in vars(Environment) if not name.startswith("_")]
    bounds = ("action_low", "action_high") if getattr(record, "action_space", None) is not None else ()
    return [name for name in members if name not in bounds and not hasattr(record, name)]


def box(bound: float, size: int) -> Float[np.ndarray, " size"]:
    """The same bound in every dimension."""
    return np.full(size, bound, np.float32)
