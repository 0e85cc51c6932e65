"""The compiled programs with which a population trains on environments outside JAX."""

import functools
from collections.abc import Callable
from typing import NamedTuple

import jax
from jaxtyping import Array, PyTree

from galton import normalization
from galton.algorithms import Agent, actor_critic
from galton.normalization import Normalizer
from galton.policies.correlation import continued
from galton.training.evaluate import deterministic_action
from galton.training.log import Log
from galton.training.programs import kept
from galton.training.run import RunState, begin, learn, over_runs, read_log, rollout_key
from galton.types import Hypers, Params


class HostPrograms(NamedTuple):
    """A group's programs, compiled at their first call on each device; all but `begin` are mapped over its runs."""

    begin: Callable[..., RunState]
    """(observation size, seeds, hypers) → runs."""
    observe: Callable[..., RunState]
    """(runs, first observations from the origin `[P, N, o]`) → runs."""
    prepare: Callable[..., PyTree[Array]]
    """Runs → the noise of their next rollout, each leaf `[P, T, N, ...]`."""
    act: Callable[..., tuple[Array, Array | None, PyTree[Array]]]
    """(params, normalizers, observations from the origin `[P, N, o]`, noise, t, hypers, what the noise goes on from,
    which episodes begin `[P, N]`) → actions, if it is on normalised observations, and what the next noise goes on
    from. Where noise is not correlated the last two arguments and the last answer are ()."""
    receive: Callable[..., tuple[Normalizer, Array, Array]]
    """(normalizers, rewards, dones, final and following observations, hypers) → as normalization.receive."""
    learn: Callable[..., RunState]
    """(runs, batch `[P, T, N]`, finished, hypers) → runs."""
    log: Callable[..., tuple[RunState, Log]]
    """(runs, batch, hypers) → runs and logs."""
    exploit: Callable[..., Array]
    """(learners, observations from the origin `[P, n, o]`, hypers) → deterministic actions."""


@kept
def host_programs(agent: Agent) -> HostPrograms:
    """The programs that train this agent, made once for each agent."""
    config = agent.config

    def begin_all(size: int, seeds: Array, hypers: Hypers) -> RunState:
        return jax.lax.map(lambda run: begin(agent, size, *run)[0], (seeds, hypers))

    def observe(run: RunState, observation: Array) -> RunState:
        learner = run.learner._replace(normalizer=normalization.observe(run.learner.normalizer, observation))
        return run._replace(learner=learner)

    def prepare(run: RunState) -> PyTree[Array]:
        return agent.policy.noise(rollout_key(run), (config.n_steps, config.n_envs))

    def act(
        params: Params,
        normalizer: Normalizer,
        observation: Array,
        noise: PyTree[Array],
        t: Array,
        hypers: Hypers,
        before: PyTree[Array],
        begins: Array | tuple[()],
    ) -> tuple[Array, Array | None, PyTree[Array]]:
        normalised = normalization.observation(normalizer, observation)
        drawn = jax.tree.map(lambda x: jax.lax.dynamic_index_in_dim(x, t, keepdims=False), noise)
        now, after = continued(agent.policy, drawn, before, begins, hypers.noise_correlation)
        action = actor_critic.act(agent, params, normalised, now, hypers)
        return action, normalised if config.normalize_observation else None, after

    return HostPrograms(
        jax.jit(begin_all, static_argnums=0),
        jax.jit(jax.vmap(observe)),
        jax.jit(jax.vmap(prepare)),
        jax.jit(jax.vmap(act, (0, 0, 0, 0, None, 0, 0, 0))),
        jax.jit(jax.vmap(normalization.receive)),
        jax.jit(over_runs(agent, functools.partial(learn, agent), (0, 0, 0, 0))),
        jax.jit(jax.vmap(functools.partial(read_log, agent))),
        jax.jit(jax.vmap(functools.partial(deterministic_action, agent))),
    )
