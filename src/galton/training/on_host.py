"""A population on environments outside JAX: one `act` per step for all runs, one update per rollout.

Runs are dealt to groups, one for each thread that the task allows; a group has its own JAX device and steps without
waiting for the others.
"""

import time
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor, wait
from typing import TypeVar

import jax
import numpy as np
from jaxtyping import Float, Int

from galton.algorithms import Agent
from galton.envs.host.base import HostEnvironments
from galton.envs.task import Task
from galton.training.host_group import Group
from galton.training.log import Log
from galton.training.run import Snapshot, Tree
from galton.training.yardsticks import Yardsticks
from galton.types import Learner, Rule

Answer = TypeVar("Answer")


class HostPopulation:
    """R runs on a task outside JAX, dealt to groups that train without waiting for each other, one for each device.

    Its methods are those of `DevicePopulation`. Each may raise BrokenEnvironmentError; the learner then stays what the
    last update made it.
    """

    def __init__(self, task: Task, agent: Agent, seeds: Sequence[int], devices: Sequence[jax.Device]) -> None:
        n_groups = min(task.n_threads, len(devices), len(seeds))
        self._slices = [slice(part[0], part[-1] + 1) for part in np.array_split(np.arange(len(seeds)), n_groups)]
        self._groups: list[Group] = []
        self._pool = ThreadPoolExecutor(n_groups) if n_groups > 1 else None
        all_seeds, threads = np.asarray(seeds, np.uint32), max(1, task.n_threads // n_groups)
        try:
            for part, device in zip(self._slices, devices, strict=False):
                own = jax.tree.map(lambda number, part=part: np.asarray(number, np.float32)[part], agent)
                self._groups.append(Group(task, own, all_seeds[part], device, threads))
            start = time.perf_counter()
            self._each(Group.begin)
            self.compile_seconds = time.perf_counter() - start
            self._each(Group.reset)
            self._is_compiled = False
        except BaseException:
            self.close()
            raise

    @property
    def step(self) -> int:
        """The environment steps that each run has taken."""
        return self._groups[0].step

    @property
    def learner(self) -> Learner:
        """All that the runs have learnt, each leaf `[R, ...]`."""
        return self._join([group.runs.learner for group in self._groups])

    @property
    def diverged_at(self) -> Int[np.ndarray, " R"]:
        """The step where a run's gradient was not finite, −1 while there is none."""
        return np.concatenate([group.diverged_at for group in self._groups])

    @property
    def environments(self) -> HostEnvironments:
        """The environments of the first group of runs, which of a single run are all."""
        return self._groups[0].environments

    def decay_over(self, begin: int, end: float) -> None:
        """Let learning rates that fall over all that is trained (decay_steps = inf) fall from one step to another."""
        self._each(Group.decay_over, begin, end)

    def compile(self) -> None:
        """Compile what training runs, unless that is done."""
        if not self._is_compiled:
            start = time.perf_counter()
            self._each(Group.warm_up)
            self.compile_seconds += time.perf_counter() - start
            self._is_compiled = True

    def advance(self, n_updates: int) -> None:
        """Train all runs for so many updates each, every group in its thread."""
        self.compile()
        self._each(Group.advance, n_updates)

    def log(self, begin_next: bool = True) -> Log:
        """The log of the updates since the last one, each number `[R]`, without evaluation."""
        return self._join(self._each(Group.log, begin_next))

    def evaluate(self, n_episodes: int, rule: Rule | None = None) -> Float[np.ndarray, "R n_episodes"]:
        """Undiscounted returns of whole episodes without exploration, on copies made for evaluation."""
        self.check_evaluation(n_episodes)
        return np.concatenate(self._each(Group.evaluate, n_episodes, rule))

    def check_evaluation(self, n_episodes: int) -> None:
        """Make the copies that evaluation plays on, and keep them for it; UsageError if there can be none."""
        for group in self._groups:
            group.evaluator.make(n_episodes)

    def yardsticks(self) -> Yardsticks:
        """The returns of doing nothing and of random actions, on the copies that evaluation plays on."""
        return self._groups[0].yardsticks()

    def put(self, learner: Learner) -> None:
        """Go on with something else learnt, each leaf `[R, ...]`."""
        for group, part in zip(self._groups, self._slices, strict=True):
            group.put(jax.tree.map(lambda x, part=part: np.asarray(x)[part], learner))

    def reseed(self, seeds: Sequence[int]) -> None:
        """Draw all that is random from here on from other seeds; environments go on with their own generators."""
        for group, part in zip(self._groups, self._slices, strict=True):
            group.reseed(np.asarray(seeds, np.uint32)[part])

    def snapshot(self) -> Snapshot:
        """Runs and environments, from which `restore` goes on exactly.

        Where the environments can't give their states its entry `environments` is missing, and `restore` begins new
        episodes.
        """
        parts = [group.snapshot() for group in self._groups]
        for name in ("environments", "statistics"):
            if any(name not in part for part in parts):
                for part in parts:
                    part.pop(name, None)
        return self._join(parts)

    def restore(self, snapshot: Snapshot) -> None:
        """Go back to a snapshot of a population of the same shape."""
        for group, part in zip(self._groups, self._slices, strict=True):
            group.restore(jax.tree.map(lambda x, part=part: np.asarray(x)[part], snapshot))

    def close(self) -> None:
        """Let go of the threads and environments."""
        if self._pool:
            self._pool.shutdown()  # it waits for those that still use an environment
        for group in self._groups:
            group.close()

    def _each(self, method: Callable[..., Answer], *arguments: object) -> list[Answer]:
        if not self._pool:
            return [method(group, *arguments) for group in self._groups]
        futures = [self._pool.submit(method, group, *arguments) for group in self._groups]
        wait(futures)  # for all of them, also where one fails
        return [future.result() for future in futures]

    @staticmethod
    def _join(parts: list[Tree]) -> Tree:
        return jax.tree.map(lambda *leaves: np.concatenate([np.asarray(leaf) for leaf in leaves]), *parts)
