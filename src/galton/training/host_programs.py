"""The compiled programs with which a population trains on environments outside JAX."""

import functools
from collections.abc import Callable, Sequence
from typing import Any

import jax
from jaxtyping import Array, PyTree

from galton import normalization
from galton.algorithms import Agent, actor_critic
from galton.normalization import Normalizer
from galton.parts import at
from galton.policies.correlation import continued
from galton.training.evaluate import deterministic_action
from galton.training.programs import kept
from galton.training.run import RunState, begin, learn, over_runs, read_log, rollout_key, step_of
from galton.types import Params

Numbers = list[Array]
"""The leaves of an agent."""

_IN_ORDER = (
    {"xla_cpu_scheduler_type": "CPU_SCHEDULER_TYPE_MEMORY_OPTIMIZED"}
    if jax.__version_info__ >= (0, 10)
    else {"xla_cpu_enable_concurrency_optimized_scheduler": False}
)
"""XLA on a CPU runs the operations of a program one after the other with these."""


class HostPrograms:
    """A group's programs, compiled at their first call on each device; all but `begin` are mapped over its runs.

    The first argument of each but `observe` is the leaves of the agent: flat, for a call to be quick.
    """

    def __init__(self, structure: Any) -> None:
        def agent_of(numbers: Sequence[Any]) -> Agent:
            return jax.tree.unflatten(structure, numbers)

        def of(function: Callable[..., Any]) -> Callable[..., Any]:
            """The function of an agent as one of its leaves."""
            return functools.wraps(function)(lambda numbers, *others: function(agent_of(numbers), *others))

        def begin_all(numbers: Numbers, size: int, seeds: Array) -> RunState:
            return jax.lax.map(lambda run: begin(agent_of(run[0]), size, run[1])[0], (numbers, seeds))

        # A step's work is microseconds, and dealing it to several threads takes longer.
        at_once = jax.default_backend() == "cpu"
        quick = functools.partial(jax.jit, compiler_options=_IN_ORDER if at_once else None)
        side_by_side = agent_of(range(structure.num_leaves)).algorithm.side_by_side
        self.begin = jax.jit(begin_all, static_argnums=1)
        """(agent, observation size, seeds) → runs."""
        self.observe = jax.jit(jax.vmap(_observe))
        """(runs, first observations from the origin `[P, N, o]`) → runs."""
        self.prepare = jax.jit(jax.vmap(of(_prepare)))
        """(agent, runs) → the noise of their next rollout, each leaf `[P, T, N, ...]`."""
        self.act = quick(jax.vmap(of(_act), (0, 0, 0, 0, 0, None, 0, 0)))
        """(agent, params, normalizers, observations from the origin `[P, N, o]`, noise, t, what the noise goes on from,
        which episodes begin `[P, N]`) → actions, if it is on normalised observations, and what the next noise goes on
        from. Where noise is not correlated the last two arguments and the last answer are ()."""
        self.receive = quick(jax.vmap(of(_receive)))
        """(agent, normalizers, rewards, dones, final and following observations) → as normalization.receive."""
        self.receive_and_act = quick(jax.vmap(of(_receive_and_act), (0, 0, 0, 0, None, 0, 0, 0, 0, 0, 0)))
        """(agent, params, normalizers, noise, t, before, begins, and what `receive` takes behind the normalizers) →
        what `receive` and `act` return: one call for two."""
        self.learn = jax.jit(over_runs(side_by_side, of(learn), (0, 0, 0, 0, 0)))
        """(agent, runs, normalizers after the rollout, batch `[P, T, N]`, finished) → runs."""
        self.log = jax.jit(jax.vmap(of(read_log)))
        """(agent, runs, batch) → runs and logs."""
        self.now = jax.jit(jax.vmap(of(_now)))
        """(agent, updates `[P]`) → the numbers of the same agent without its schedules."""
        self.exploit = quick(jax.vmap(of(deterministic_action)))
        """(agent, learners, observations from the origin `[P, n, o]`) → deterministic actions."""


host_programs = kept(HostPrograms)
"""The programs that train agents of a tree structure, made once for each."""


def _observe(run: RunState, observation: Array) -> RunState:
    learner = run.learner._replace(normalizer=normalization.observe(run.learner.normalizer, observation))
    return run._replace(learner=learner)


def _prepare(agent: Agent, run: RunState) -> PyTree[Array]:
    return agent.policy.noise(rollout_key(agent, run), (agent.rollout.n_steps, agent.rollout.n_envs))


def _act(
    agent: Agent,
    params: Params,
    normalizer: Normalizer,
    observation: Array,
    noise: PyTree[Array],
    t: Array,
    before: PyTree[Array],
    begins: Array | tuple[()],
) -> tuple[Array, Array | None, PyTree[Array]]:
    normalised = normalization.observation(normalizer, observation)
    drawn = jax.tree.map(lambda x: jax.lax.dynamic_index_in_dim(x, t, keepdims=False), noise)
    now, after = continued(agent.policy, drawn, before, begins, agent.rollout.noise_correlation)
    action = actor_critic.act(agent, params, normalised, now)
    return action, normalised if agent.rollout.normalize_observation else None, after


def _receive(
    agent: Agent, normalizer: Normalizer, reward: Array, done: Array, final: Array, following: Array
) -> tuple[Normalizer, Array, Array]:
    gamma, window = agent.algorithm.gamma, agent.rollout.normalize_window
    return normalization.receive(normalizer, reward, done, final, following, gamma, window)


def _receive_and_act(
    agent: Agent,
    params: Params,
    normalizer: Normalizer,
    noise: PyTree[Array],
    t: Array,
    before: PyTree[Array],
    begins: Array | tuple[()],
    *received: Array,
) -> tuple[tuple[Normalizer, Array, Array], tuple[Array, Array | None, PyTree[Array]]]:
    told = _receive(agent, normalizer, *received)
    return told, _act(agent, params, told[0], received[-1], noise, t, before, begins)


def _now(agent: Agent, updates: Array) -> Numbers:
    return jax.tree.leaves(at(agent, step_of(agent, updates)))
