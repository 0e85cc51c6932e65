"""The copies of a task outside JAX that evaluation plays on, made once for many evaluations."""

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from jaxtyping import Float, Integer

from galton.envs.host.base import HostEnvironments
from galton.envs.host.carried import Remembered, beside, carry
from galton.envs.task import Task
from galton.parts import Box
from galton.training.evaluate import copies, play
from galton.training.yardsticks import N_EPISODES, Yardsticks, yardsticks


class Evaluator:
    """Copies for n episodes of each of P runs; they are made by `make`, and kept as long as n stays the same."""

    def __init__(self, task: Task, n_runs: int, n_threads: int) -> None:
        self._task, self._n_runs, self._n_threads = task, n_runs, n_threads
        self._envs: HostEnvironments | None = None
        self._begun: list[Remembered] = []
        self._n_episodes = 0

    def make(self, n_episodes: int) -> HostEnvironments:
        """The copies for so many episodes of each run; UsageError if there can be none."""
        if self._envs is None or self._n_episodes != n_episodes:
            self.close()
            self._envs = copies(self._task, self._n_runs * n_episodes, self._n_threads)
            self._begun, self._n_episodes = [], n_episodes
        return self._envs

    def evaluate(
        self,
        trained: Sequence[list[Any]],
        at_first: Sequence[Remembered],
        seeds: Integer[np.ndarray, " M"],
        act: Callable[[Float[np.ndarray, "M o"]], Float[np.ndarray, "M d"]],
    ) -> Float[np.ndarray, " M"]:
        """Undiscounted returns of an episode on each copy, once it is what one of training's is by now."""
        envs = self._of_now(len(seeds) // self._n_runs, trained, at_first)
        return play(self._task.name, envs, seeds, act, len(seeds))

    def yardsticks(self, trained: Sequence[list[Any]], at_first: Sequence[Remembered], box: Box) -> Yardsticks:
        """The returns of doing nothing and of random actions on these copies."""
        envs = self._of_now(self._n_episodes or N_EPISODES, trained, at_first)
        return yardsticks(self._task.name, envs, self._n_runs * self._n_episodes, box)

    def _of_now(self, n: int, trained: Sequence[list[Any]], at_first: Sequence[Remembered]) -> HostEnvironments:
        """The copies for n episodes of each run, each like one of training's by now."""
        envs, n_envs = self.make(n), len(trained) // self._n_runs
        like = [i // n * n_envs + i % n % n_envs for i in range(len(envs.layers))]
        if not self._begun and like:
            envs.reset(np.arange(len(like)))
            self._begun = [beside(layers, at_first[copy]) for copy, layers in zip(like, envs.layers, strict=True)]
        for copy, layers, first in zip(like, envs.layers, self._begun, strict=True):
            carry(trained[copy], at_first[copy], layers, first)
        return envs

    def close(self) -> None:
        """Close the copies, if there are any."""
        if self._envs:
            self._envs.close()
            self._envs = None
