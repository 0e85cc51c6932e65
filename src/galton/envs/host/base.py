"""Copies of a task that are stepped from Python."""

from collections.abc import Sequence
from typing import Any, NamedTuple, Protocol, runtime_checkable

import gymnasium
import numpy as np
from jaxtyping import Bool, Float, Integer

from galton.envs.host.moves import Moves

Space = gymnasium.Space[Any]
"""A Gymnasium space, whatever is in it."""


class Steps(NamedTuple):
    """One step of M copies; numpy arrays."""

    observation: Float[np.ndarray, "M o"]
    """The observation to act on next: where an episode ended, the first of the next."""
    final_observation: Float[np.ndarray, "M o"]
    """The observation that the step led to, before any reset."""
    reward: Float[np.ndarray, " M"]
    terminated: Bool[np.ndarray, " M"]
    truncated: Bool[np.ndarray, " M"]


@runtime_checkable
class HostEnvironments(Protocol):
    """M copies of a task, stepped together from Python. Observations are flat, in float32 or float64.

    Every method raises BrokenEnvironmentError, which names the copy, where one raises or returns what it must not.
    """

    @property
    def moves(self) -> Sequence[Moves]:
        """The counts of their moves, for copies that somebody else may hold too; empty if nobody can."""

    @property
    def layers(self) -> Sequence[list[Any]]:
        """For each copy its wrappers from the outside in, and the environment; empty if there is no Python in it."""

    def reset(self, seeds: Integer[np.ndarray, " M"]) -> Float[np.ndarray, "M o"]:
        """Begin episodes; a copy's seed decides all of its future."""

    def step(self, action: Float[np.ndarray, "M d"]) -> Steps:
        """Act, clipped into the box, and begin new episodes where one ended."""

    def get_state(self) -> dict[str, np.ndarray] | None:
        """All that `set_state` needs to go on exactly, each array `[M, ...]`; None if the environments can't tell."""

    def set_state(self, state: dict[str, np.ndarray]) -> None:
        """Go on from there, without a reset."""

    def close(self) -> None:
        """Let go of what `Task.make` made."""
