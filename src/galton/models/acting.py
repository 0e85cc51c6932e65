"""A policy acts on observations outside training, and plays whole episodes."""

import functools
from collections.abc import Sequence
from typing import Any

import jax
import numpy as np
from jaxtyping import Array, Float

from galton import normalization
from galton.algorithms import Agent, actor_critic
from galton.envs.host.statistics import take_statistics
from galton.envs.jax_task import JaxTask
from galton.envs.task import Task
from galton.normalization import from_origin_on_host
from galton.training.evaluate import deterministic_action, evaluate, opened, play
from galton.types import Learner

Rows = Float[np.ndarray, "n o"]


def exploit(agent: Agent, learner: Learner, rows: Rows) -> Float[np.ndarray, "n d"]:
    """The deterministic action for each observation."""
    return np.asarray(_deterministic(agent, learner, from_origin_on_host(learner.normalizer, rows)))


def explore(agent: Agent, learner: Learner, rows: Rows, seed: int, n: int) -> Float[np.ndarray, "n d"]:
    """A sampled action for each observation of the n-th batch that a model of this seed is asked about."""
    if not len(rows):  # JAX has no noise of no size
        return np.zeros((0, len(agent.low)), np.float32)
    key = jax.random.fold_in(jax.random.key(seed), n)
    return np.asarray(_sampled(agent, learner, from_origin_on_host(learner.normalizer, rows), key))


def returns_on(
    task: Task,
    agent: Agent,
    learner: Learner,
    n_episodes: int,
    seed: int,
    step: int,
    statistics: Sequence[dict[str, Any]],
) -> Float[np.ndarray, " n_episodes"]:
    """Undiscounted returns of whole episodes without exploration, on copies of an environment, or on those given.

    Seed and step of the model decide on the episodes. Wrappers that normalise observations do so by the statistics of
    each copy that the model is trained on, where there are some.
    """
    if isinstance(task, JaxTask):
        key = jax.random.fold_in(jax.random.key(seed), step % 2**32)
        return np.asarray(_evaluated(key, task, agent, learner, n_episodes))
    with opened(task, n_episodes) as (envs, n_copies):
        for i, layers in enumerate(envs.layers):
            take_statistics(task.name, layers, statistics[i % len(statistics)] if statistics else None)
        seeds = np.random.SeedSequence((seed, 1, step)).generate_state(n_copies)
        return play(task.name, envs, seeds, functools.partial(exploit, agent, learner), n_episodes)


_deterministic = jax.jit(deterministic_action)
_evaluated = jax.jit(evaluate, static_argnames="n_episodes")


@jax.jit
def _sampled(agent: Agent, learner: Learner, rows: Array, key: Array) -> Array:
    normalised = normalization.observation(learner.normalizer, rows)
    return actor_critic.act(agent, learner.params, normalised, agent.policy.noise(key, rows.shape[:1]))
