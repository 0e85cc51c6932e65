"""Arithmetic says how much memory runs need at least: what can't fit is refused before it is made."""

import math
from collections.abc import Sequence
from typing import Any

import jax
import numpy as np

from galton.algorithms import Agent
from galton.devices import device_memory, memory
from galton.envs.jax_task import JaxTask
from galton.envs.task import Task
from galton.errors import require
from galton.networks import Network
from galton.parts import at, settings

COPY = 1_000
"""Bytes that a copy of an environment outside JAX has at least."""


def check_size(task: Task, agent: Agent, n_runs: int, n_eval_episodes: int = 0) -> None:
    """Raise UsageError where this process can't have the memory that training would need, and say what to lower."""
    outside, room = not isinstance(task, JaxTask), memory()
    n_envs, n_steps = agent.rollout.n_envs, agent.rollout.n_steps
    d, o = len(task.actions.box.low), task.observations.size
    step = 4 * (2 * o + d + 1)
    numbers = _n_parameters(agent.network, o, d, of_critic=False) + _n_parameters(agent.network, o, 1, of_critic=True)
    parts = {
        _sizes(agent.network): 4 * 3 * numbers,  # Adam has 2
        f"n_envs or n_steps is {n_envs} or {n_steps}": n_envs * (n_steps * step + COPY * outside),
        f"n_eval_episodes is {n_eval_episodes}": n_eval_episodes * (4 * o + COPY * outside),
    }
    one = sum(parts.values())
    told = max(parts, key=lambda part: parts[part]) if one > room else f"seeds is {n_runs} of them"
    require(
        one * n_runs <= room,
        f"{told}, too many: this needs {one * n_runs / 1e9:,.1f} GB of memory at least, and there are "
        f"{room / 1e9:,.1f}; make it smaller",
    )


def check_programs(programs: Sequence[Any], agent: Agent, devices: Sequence[jax.Device]) -> None:
    """Raise UsageError where compiled programs need more memory than there is, and say how many copies fit.

    Args:
        programs: they run one after the other.
        agent: whose rollouts' length says most of what they need.
        devices: those that they run on, side by side.
    """
    of_each = max(_bytes(program.memory_analysis()) for program in programs)
    needed = of_each * (len(devices) if devices[0].platform == "cpu" else 1)
    room, n_envs = device_memory(devices[0]), agent.rollout.n_envs
    require(
        needed <= room,
        f"n_envs is {n_envs} and n_steps {agent.rollout.n_steps}: training needs {needed / 1e9:,.1f} GB of memory, and "
        f"there are {room / 1e9:,.1f}; n_envs = {max(1, int(n_envs * room / needed))} fits, or fewer steps or runs",
    )


def _bytes(told: Any) -> int:
    """The bytes that a program needs besides its code; what it returns in the place of an argument counts once."""
    return int(
        told.temp_size_in_bytes + told.argument_size_in_bytes + told.output_size_in_bytes - told.alias_size_in_bytes
    )


def _sizes(network: Network) -> str:
    """The settings of a network that say how large it is."""
    named = {name: getattr(network, name) for name in settings(type(network))}
    return " and ".join(f"{name} is {value}" for name, value in named.items() if isinstance(value, int | tuple))


def _n_parameters(network: Network, n_in: int, n_out: int, *, of_critic: bool) -> int:
    of_one = at(jax.tree.map(lambda number: np.ravel(number)[0], network), 0.0)
    made = jax.eval_shape(lambda key: of_one.init(key, n_in, n_out, 1.0, of_critic), jax.random.key(0))
    return sum(math.prod(leaf.shape) for leaf in jax.tree.leaves(made))
