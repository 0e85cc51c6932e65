"""An environment whose actions are in other units: the box that policies see is so many times the environment's own."""

import dataclasses
from collections.abc import Sequence
from typing import Any

import numpy as np
from gymnasium.spaces import Box
from jaxtyping import Array, Bool, Float, Integer, Key, PyTree

from galton.envs.base import Environment
from galton.envs.host.base import HostEnvironments, HostTask, Space, Steps
from galton.envs.host.moves import Moves
from galton.errors import UsageError, is_number, require


def rescaled(env: Environment | HostTask, action_scale: object) -> Environment | HostTask:
    """The environment with its action box times the scale; what is done there is the action over the scale.

    By a power of two, floating point changes no bit but the exponent: a policy that is told its box alone must then
    learn the same.

    Raises:
        UsageError: a scale that is no finite number greater than 0.
    """
    fits = is_number(action_scale) and 0 < action_scale < float("inf")  # type: ignore[operator]
    require(fits, f"action_scale is {action_scale!r}; it must be a finite number greater than 0")
    scale = float(action_scale)  # type: ignore[arg-type]
    return Rescaled(env, scale) if isinstance(env, Environment) else RescaledTask(env, scale)


@dataclasses.dataclass(frozen=True)
class Rescaled:
    """An environment in JAX whose actions are the policy's over the scale."""

    env: Environment
    action_scale: float

    @property
    def action_low(self) -> Float[np.ndarray, " d"]:
        """The lower bounds of the box that the policy sees."""
        return self.env.action_low * np.float32(self.action_scale)

    @property
    def action_high(self) -> Float[np.ndarray, " d"]:
        """The upper bounds of the box that the policy sees."""
        return self.env.action_high * np.float32(self.action_scale)

    @property
    def observation_low(self) -> Float[np.ndarray, " o"]:
        """The lower bounds of the observations, which no scale of the actions changes."""
        return self.env.observation_low

    @property
    def observation_high(self) -> Float[np.ndarray, " o"]:
        """The upper bounds of the observations, which no scale of the actions changes."""
        return self.env.observation_high

    @property
    def max_episode_steps(self) -> int:
        """After how many steps the wrapped environment's episodes are cut off."""
        return self.env.max_episode_steps

    @property
    def optimal_return(self) -> float | None:
        """The environment's own: the same actions can be taken."""
        return self.env.optimal_return

    @property
    def random_return(self) -> float | None:
        """The environment's own: uniform actions stay uniform."""
        return self.env.random_return

    def reset(self, key: Key[Array, ""]) -> PyTree[Array]:
        """The environment's first state."""
        return self.env.reset(key)

    def noise(self, key: Key[Array, ""]) -> PyTree[Array]:
        """The randomness of one step of the environment."""
        return self.env.noise(key)

    def step(
        self, state: PyTree[Array], action: Float[Array, " d"], noise: PyTree[Array]
    ) -> tuple[PyTree[Array], Float[Array, ""], Bool[Array, ""]]:
        """One step of the environment under the action over the scale."""
        return self.env.step(state, action / np.float32(self.action_scale), noise)

    def observe(self, state: PyTree[Array]) -> Float[Array, " o"]:
        """What the environment shows of a state."""
        return self.env.observe(state)


class RescaledTask:
    """A task outside JAX whose actions are the policy's over the scale."""

    def __init__(self, task: HostTask, action_scale: float) -> None:
        self._task, self.action_scale = task, np.float32(action_scale)

    @property
    def name(self) -> str:
        """What messages call the task."""
        return f"{self._task.name} with actions times {self.action_scale:g}"

    @property
    def action_space(self) -> Box:
        """The box that the policy sees."""
        own = self._task.action_space
        if not isinstance(own, Box):
            raise UsageError(f"action_scale is {self.action_scale:g}, but the actions of {self._task.name} are {own}")
        kind = np.promote_types(own.dtype, np.float32)
        low, high = (bound.astype(kind) * self.action_scale for bound in (own.low, own.high))
        return Box(low, high, dtype=kind.type)

    @property
    def observation_space(self) -> Space:
        """One copy's observation space, which no scale of the actions changes."""
        return self._task.observation_space

    @property
    def n_threads(self) -> int:
        """How many threads may step different copies of the wrapped task at once."""
        return self._task.n_threads

    @property
    def given(self) -> int | None:
        """How many copies of the wrapped task the user gave ready-made; None if `make` makes them."""
        return self._task.given

    def make(self, n_copies: int, n_threads: int = 1) -> "RescaledEnvironments":
        """That many copies of the task."""
        return RescaledEnvironments(self._task.make(n_copies, n_threads), self.action_scale)


class RescaledEnvironments:
    """Copies of a task whose actions are the policy's over the scale."""

    def __init__(self, envs: HostEnvironments, action_scale: np.float32) -> None:
        self._envs, self._action_scale = envs, action_scale

    @property
    def moves(self) -> Sequence[Moves]:
        """The counts of the wrapped copies' moves; empty if nobody else can hold them."""
        return self._envs.moves

    @property
    def layers(self) -> Sequence[list[Any]]:
        """The wrapped copies' layers."""
        return self._envs.layers

    def reset(self, seeds: Integer[np.ndarray, " M"]) -> Float[np.ndarray, "M o"]:
        """Begin episodes; a copy's seed decides all of its future."""
        return self._envs.reset(seeds)

    def step(self, action: Float[np.ndarray, "M d"]) -> Steps:
        """Act by the action over the scale; the environment clips it into its own box, which is the same."""
        return self._envs.step(action / self._action_scale)

    def get_state(self) -> dict[str, np.ndarray] | None:
        """All that `set_state` needs to go on exactly, as the wrapped copies tell it; None if they can't."""
        return self._envs.get_state()

    def set_state(self, state: dict[str, np.ndarray]) -> None:
        """Go on from there, without a reset."""
        self._envs.set_state(state)

    def close(self) -> None:
        """Let go of what the task made."""
        self._envs.close()
