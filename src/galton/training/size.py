"""How much memory runs need at least, by arithmetic: what can't fit is refused before anything of its size is made."""

import itertools

from galton.algorithms import Agent
from galton.devices import memory
from galton.envs.base import Environment
from galton.envs.host.action_box import ActionBox
from galton.envs.host.base import HostTask
from galton.envs.host.observations import Observations
from galton.errors import require

COPY = 1_000
"""Bytes that a copy of an environment outside JAX has at least."""


def check_size(env: Environment | HostTask, agent: Agent, n_runs: int, n_eval_episodes: int = 0) -> None:
    """Raise UsageError where this process can't have the memory that training would need, and say what to lower.

    Args:
        env: what is trained on.
        agent: of every run.
        n_runs: how many there are, one for each of `seeds`.
        n_eval_episodes: of each evaluation.
    """
    outside, room = not isinstance(env, Environment), memory()
    n_envs, n_steps, net_arch = agent.rollout.n_envs, agent.rollout.n_steps, agent.network.net_arch
    d, o = _widths(env)
    step = 4 * (2 * o + d + 1)
    parts = {
        "net_arch": 4 * 3 * (_n_parameters(o, net_arch, d) + _n_parameters(o, net_arch, 1)),  # Adam has 2
        "n_envs or n_steps": n_envs * (n_steps * step + COPY * outside),
        "n_eval_episodes": n_eval_episodes * (4 * o + COPY * outside),
    }
    one = sum(parts.values())
    name = max(parts, key=lambda part: parts[part]) if one > room else "seeds"
    given = {
        "net_arch": f"{net_arch}",
        "n_envs or n_steps": f"{n_envs} or {n_steps}",
        "n_eval_episodes": f"{n_eval_episodes}",
        "seeds": f"{n_runs} of them",
    }[name]
    require(
        one * n_runs <= room,
        f"{name} is {given}, too many: this needs {one * n_runs / 1e9:,.1f} GB of memory at least, and there are "
        f"{room / 1e9:,.1f}; make it smaller",
    )


def _widths(env: Environment | HostTask) -> tuple[int, int]:
    """How many numbers an action and an observation have."""
    if isinstance(env, Environment):
        return len(env.action_low), len(env.observation_low)
    return len(ActionBox(env.name, env.action_space).low), Observations(env.name, env.observation_space).size


def _n_parameters(n_in: int, hidden: tuple[int, ...], n_out: int) -> int:
    sizes = (n_in, *hidden, n_out)
    return sum(a * b + b for a, b in itertools.pairwise(sizes))
