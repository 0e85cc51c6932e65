"""What an environment has to offer: in pure JAX, or outside it."""

from typing import Any, NamedTuple, Protocol, runtime_checkable

import gymnasium
import numpy as np
from jaxtyping import Array, Bool, Float, Integer, Key, PyTree


@runtime_checkable
class Environment(Protocol):
    """A task as pure functions of one state; constants are fields of a frozen record.

    The randomness of a step is drawn ahead by `noise`, so that `step` is deterministic: s' = f(s, a, w). Episodes
    end when `step` terminates or after `max_episode_steps`, which the caller counts. Actions arrive clipped into
    the box.
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
        """The time limit."""

    @property
    def optimal_return(self) -> float | None:
        """The best expected undiscounted return, where it is known."""

    @property
    def random_return(self) -> float | None:
        """The expected undiscounted return of uniformly random actions, where it is known."""

    def reset(self, key: Key[Array, ""]) -> Any:
        """A first state: any pytree of arrays."""

    def noise(self, key: Key[Array, ""]) -> PyTree[Array]:
        """The randomness of one step; () for a deterministic task."""

    def step(
        self, state: Any, action: Float[Array, " d"], noise: PyTree[Array]
    ) -> tuple[Any, Float[Array, ""], Bool[Array, ""]]:
        """The next state, the reward and whether the task ended."""

    def __hash__(self) -> int:
        """Programs are compiled once per record."""

    def observe(self, state: Any) -> Float[Array, " o"]:
        """What the agent sees of a state."""


def box(bound: float, size: int) -> Float[np.ndarray, " size"]:
    """The same bound in every dimension."""
    return np.full(size, bound, np.float32)


class Steps(NamedTuple):
    """One step of M environments outside JAX; numpy arrays."""

    observation: Float[np.ndarray, "M o"]
    """What to act on next: where an episode ended, the first observation of the next."""
    final_observation: Float[np.ndarray, "M o"]
    """What the step led to, before any reset."""
    reward: Float[np.ndarray, " M"]
    terminated: Bool[np.ndarray, " M"]
    truncated: Bool[np.ndarray, " M"]


@runtime_checkable
class HostEnvironments(Protocol):
    """M copies of a task outside JAX, stepped together. Observations are flat and float32.

    Every method raises BrokenEnvironmentError, which names the copy, where one raises or returns what it must not.
    """

    def reset(self, seeds: Integer[np.ndarray, " M"]) -> Float[np.ndarray, "M o"]:
        """Begin episodes; a copy's seed decides all of its future."""

    def step(self, action: Float[np.ndarray, "M d"]) -> Steps:
        """Act, clipped into the box, and begin new episodes where one ended."""

    def get_state(self) -> dict[str, np.ndarray] | None:
        """All that `set_state` needs to go on exactly, each array `[M, ...]`; None if the environments can't tell."""

    def set_state(self, state: dict[str, np.ndarray]) -> None:
        """Go on from there, without a reset."""

    def close(self) -> None:
        """Let go of what `HostTask.make` made."""


@runtime_checkable
class HostTask(Protocol):
    """A task outside JAX, before any copy of it exists."""

    @property
    def name(self) -> str:
        """What messages call it."""

    @property
    def action_space(self) -> gymnasium.spaces.Box:
        """Gymnasium's, for one copy."""

    @property
    def observation_space(self) -> gymnasium.Space[Any]:
        """Gymnasium's, for one copy."""

    @property
    def n_threads(self) -> int:
        """How many threads may step different copies at once."""

    @property
    def given(self) -> int | None:
        """How many copies the user gave ready-made, which then are all that there are; None if `make` makes them."""

    def make(self, n_copies: int, n_threads: int = 1) -> HostEnvironments:
        """That many copies, stepped on that many threads.

        Raises:
            UsageError: more than there are.
        """
