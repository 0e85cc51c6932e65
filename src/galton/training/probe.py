"""Environments as they are found by playing in them for a moment: what `check_env` looks at."""

import dataclasses
import time
from collections.abc import Callable
from typing import Any, NamedTuple

import gymnasium
import numpy as np
from gymnasium.spaces import Box
from jaxtyping import Float, Integer

from galton.envs.host.answers import blame
from galton.envs.host.base import HostEnvironments
from galton.envs.host.statistics import frozen
from galton.training.yardsticks import Act


class Spread:
    """Mean, deviation and range of the entries of many vectors, in float64 and without keeping them."""

    def __init__(self) -> None:
        self.n, self._first, self._sum, self._squares = 0, np.zeros(()), np.zeros(()), np.zeros(())
        self.low, self.high = np.full((), np.inf), np.full((), -np.inf)

    def add(self, rows: Float[np.ndarray, "n e"]) -> None:
        """Count n further vectors, each of the same entries."""
        rows = rows.astype(np.float64)
        self._first = self._first if self.n else rows[0]
        self.n += len(rows)
        self._sum = self._sum + (rows - self._first).sum(0)
        self._squares = self._squares + np.square(rows - self._first).sum(0)
        self.low, self.high = np.minimum(self.low, rows.min(0)), np.maximum(self.high, rows.max(0))

    @property
    def mean(self) -> Float[np.ndarray, " e"]:
        """The mean of each entry over all vectors."""
        return self._first + self._sum / self.n

    @property
    def deviation(self) -> Float[np.ndarray, " e"]:
        """The standard deviation of each entry; exactly 0 of one that never moved."""
        spread: np.ndarray = np.sqrt(np.maximum(self._squares / self.n - np.square(self._sum / self.n), 0.0))
        return np.where(self.low == self.high, 0.0, spread)


@dataclasses.dataclass
class Played:
    """The outcome of playing in M copies; rewards are those that the environment gives."""

    n_steps: int = 0
    """Steps of each copy."""
    seconds: float = 0.0
    """The seconds that they took in the environment."""
    n_terminated: int = 0
    returns: list[float] = dataclasses.field(default_factory=list)
    """Undiscounted, of each episode that ended."""
    lengths: list[int] = dataclasses.field(default_factory=list)
    """In steps, of each episode that ended."""
    rewards: Spread = dataclasses.field(default_factory=Spread)
    observations: Spread = dataclasses.field(default_factory=Spread)


def played(
    envs: HostEnvironments, seeds: Integer[np.ndarray, " M"], act: Act, n_episodes: int, seconds: float
) -> Played:
    """Play for so many episodes, or for so long; one step at least. Statistics of wrappers stay as they are."""
    found = Played()
    with frozen(envs.layers) as as_given:
        observation, end = envs.reset(seeds), time.perf_counter() + seconds
        collected, length = np.zeros(len(seeds)), np.zeros(len(seeds), int)
        while not found.n_steps or (len(found.returns) < n_episodes and time.perf_counter() < end):
            action, start = act(observation), time.perf_counter()
            steps = envs.step(action)
            found.seconds += time.perf_counter() - start
            reward = np.asarray(as_given(steps.reward), np.float64)
            found.n_steps += 1
            found.rewards.add(reward[:, None])
            found.observations.add(steps.final_observation)
            collected += reward
            length += 1
            for i in np.flatnonzero(steps.terminated | steps.truncated):
                found.returns.append(float(collected[i]))
                found.lengths.append(int(length[i]))
                found.n_terminated += int(steps.terminated[i])
                collected[i], length[i] = 0.0, 0
            observation = steps.observation
    return found


class Repeated(NamedTuple):
    """The answers to whether the same seeds give the same episodes, and whether another action makes them others."""

    n_steps: int
    """The number of steps that were compared."""
    same_start: bool
    same_steps: bool
    actions_matter: bool


def repeated(
    envs: HostEnvironments,
    seeds: Integer[np.ndarray, " M"],
    act: Callable[[], Act],
    other: Act,
    n_steps: int = 20,
    seconds: float = 0.3,
) -> Repeated:
    """Play the beginning of episodes from the same seeds three times: by `act`, by `act` anew, and by `other`."""

    def steps(act: Act, n: int, seconds: float) -> tuple[np.ndarray, list[np.ndarray]]:
        answers: list[np.ndarray] = []
        first, end = envs.reset(seeds), np.inf
        observation = first
        while len(answers) < n and time.perf_counter() < end:
            answer = envs.step(act(observation))
            end = end if answers else time.perf_counter() + seconds  # the first may have to compile
            answers.append(np.column_stack([answer.final_observation, answer.reward, answer.terminated]))
            observation = answer.observation
        return first, answers

    with frozen(envs.layers):
        first, one = steps(act(), n_steps, seconds)
        again, two = steps(act(), len(one), np.inf)
        _, three = steps(other, len(one), np.inf)
    return Repeated(len(one), np.array_equal(first, again), np.array_equal(one, two), not np.array_equal(one, three))


def aliases(layers: list[Any]) -> bool:
    """True if the observation of a step lies in the memory of the one before it, which it then overwrites.

    Of what does not live in this process, or takes no Box below its wrappers, it is not known, and False.
    """
    env = next((layer for layer in layers if isinstance(layer, gymnasium.Env)), None)
    space: Any = env and env.action_space
    if env is None or not isinstance(space, Box):
        return False
    with frozen([layers]), blame("reset and step"):
        first = env.reset(seed=0)[0]
        action = np.clip(np.zeros(space.shape, space.dtype), space.low, space.high)
        second = env.step(action)[0]
    return any(np.shares_memory(one, other) for one in _arrays(first) for other in _arrays(second))


def _arrays(observation: Any) -> list[np.ndarray]:
    if isinstance(observation, dict):
        return [array for part in observation.values() for array in _arrays(part)]
    if isinstance(observation, tuple | list):
        return [array for part in observation for array in _arrays(part)]
    return [observation] if isinstance(observation, np.ndarray) else []
