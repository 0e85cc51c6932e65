"""R runs that are trained side by side, wherever their environments live."""

import warnings
from collections.abc import Sequence

import jax
import numpy as np

from galton.algorithms import Agent
from galton.envs.find import find
from galton.envs.host.observations import IMAGE_REMEDY
from galton.envs.jax_task import JaxTask
from galton.errors import require
from galton.training.on_device import DevicePopulation
from galton.training.on_host import HostPopulation
from galton.training.programs import check_process
from galton.training.programs_on_disk import keep_programs
from galton.training.size import check_size

Population = DevicePopulation | HostPopulation
"""R runs of agents of one structure, with the same methods wherever their environments live."""


def populate(
    env: object, agent: Agent, seeds: Sequence[int], devices: Sequence[jax.Device] | None = None
) -> Population:
    """R new runs, one per seed.

    Args:
        env: what `galton.envs.find` takes.
        agent: whose numbers are `[R]` each, or one for all runs.
        seeds: R integers.
        devices: what to compute on, which runs are split over, or the copies of an environment in JAX of a single run;
            by default all of this process, but for a single run on a CPU, which takes one.

    Raises:
        UsageError: an environment that can't be used, or that the agent can't act in, too little memory, or a process
            that was forked from one that trains.
    """
    check_process()
    keep_programs()
    task = find(env)
    if not devices:  # on a CPU a single run's bits don't depend on the number of cores
        devices = jax.devices()[:1] if len(seeds) == 1 and jax.default_backend() == "cpu" else jax.devices()
    check_size(task, agent, len(seeds))
    if task.observations.has_image and not agent.rollout.normalize_observation:
        warnings.warn(f"{task.name} observes {task.observations.space}: {IMAGE_REMEDY}", stacklevel=2)
    agent = jax.tree.map(lambda number: np.broadcast_to(number, len(seeds)), agent.on(task.actions.box))
    if isinstance(task, JaxTask):
        slow = agent.rollout.resets == "fresh" and getattr(task.record, "resets_slowly", False)
        require(
            not slow,
            f"resets is 'fresh', which would reset {task.name} at each of n_steps · n_envs steps, and its resets are "
            "slow; make resets 'first' or 'pool'",
        )
        return DevicePopulation(task, agent, seeds, devices)
    resets = agent.rollout.resets
    require(resets == "fresh", f"resets is {resets!r}, but {task.name} is no environment in JAX and resets itself")
    return HostPopulation(task, agent, seeds, devices)
