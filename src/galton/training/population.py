"""R runs that are trained side by side, wherever their environments live."""

import warnings
from collections.abc import Sequence
from typing import Protocol, runtime_checkable

import jax
import numpy as np
from jaxtyping import Float, Int

from galton.algorithms import Agent
from galton.envs.find import find
from galton.envs.host.base import HostEnvironments
from galton.envs.host.observations import IMAGE_REMEDY
from galton.envs.jax_task import JaxTask
from galton.errors import require
from galton.training.log import Log
from galton.training.on_device import DevicePopulation
from galton.training.on_host import HostPopulation
from galton.training.programs import check_process
from galton.training.programs_on_disk import keep_programs
from galton.training.run import Snapshot
from galton.training.size import check_size
from galton.training.yardsticks import Yardsticks
from galton.types import Learner, Rule


@runtime_checkable
class Population(Protocol):
    """R runs of agents of one structure. All arrays that go in or out are numpy's, with a leading axis R."""

    compile_seconds: float
    """How long compiling took so far."""

    @property
    def step(self) -> int:
        """How many environment steps each run has taken."""

    @property
    def learner(self) -> Learner:
        """What the runs have learnt, each leaf `[R, ...]`."""

    @property
    def diverged_at(self) -> Int[np.ndarray, " R"]:
        """The step where a run's gradient was not finite, −1 while there is none."""

    @property
    def environments(self) -> HostEnvironments | None:
        """What the first group of runs is trained on; None for environments in JAX."""

    def decay_over(self, begin: int, end: int) -> None:
        """Let learning rates that fall over all that is trained (decay_steps = inf) fall from one step to another."""

    def compile(self) -> None:
        """Compile what training runs, unless that is done; the first `advance` does it otherwise."""

    def advance(self, n_updates: int) -> None:
        """Train all runs for so many updates each. The results do not depend on how training is cut into calls.

        Raises:
            BrokenEnvironmentError: an environment broke; the learner stays what the last update made it.
        """

    def log(self, begin_next: bool = True) -> Log:
        """What is recorded of the updates since the last log, each number `[R]`, without evaluation.

        With begin_next=False this one only looks: the next log has the same updates again.
        """

    def evaluate(self, n_episodes: int, rule: Rule | None = None) -> Float[np.ndarray, "R n_episodes"]:
        """Undiscounted returns of whole episodes without exploration; training is not touched by it.

        The rule says which deterministic action is taken; None is the configuration's. The episodes are the same.
        """

    def check_evaluation(self, n_episodes: int) -> None:
        """Raise UsageError unless `evaluate` can play that many episodes: where it is known, before training."""

    def yardsticks(self) -> Yardsticks:
        """What doing nothing and random actions return, on the copies that `evaluate` plays on.

        Training is not touched by it.
        """

    def put(self, learner: Learner) -> None:
        """Go on with something else learnt, each leaf `[R, ...]`, also where a run had diverged."""

    def reseed(self, seeds: Sequence[int]) -> None:
        """Draw all that is random from here on from other seeds. Episodes that have begun go on."""

    def snapshot(self) -> Snapshot:
        """A pytree of arrays from which `restore` goes on exactly.

        Where the environments can't give their states its entry `environments` is missing, and `restore` begins new
        episodes.
        """

    def restore(self, snapshot: Snapshot) -> None:
        """Go back to a snapshot of a population of the same shape."""

    def close(self) -> None:
        """Let go of environments that this population made."""


def populate(
    env: object, agent: Agent, seeds: Sequence[int], devices: Sequence[jax.Device] | None = None
) -> Population:
    """R new runs, one per seed.

    Args:
        env: what `galton.envs.find` takes.
        agent: whose numbers are `[R]` each, or one for all runs.
        seeds: R integers.
        devices: what to compute on; by default, on all of this process.

    Raises:
        UsageError: an environment that can't be used, or that the agent can't act in, too little memory, or a process
            that was forked from one that trains.
    """
    check_process()
    keep_programs()
    task, devices = find(env), devices or jax.devices()
    check_size(task, agent, len(seeds))
    if task.observations.has_image and not agent.rollout.normalize_observation:
        warnings.warn(f"{task.name} observes {task.observations.space}: {IMAGE_REMEDY}", stacklevel=2)
    agent = jax.tree.map(lambda number: np.broadcast_to(number, len(seeds)), agent.on(task.actions.box))
    if isinstance(task, JaxTask):
        return DevicePopulation(task, agent, seeds, devices)
    resets = agent.rollout.resets
    require(resets == "fresh", f"resets is {resets!r}, but {task.name} is no environment in JAX and resets itself")
    return HostPopulation(task, agent, seeds, devices)
