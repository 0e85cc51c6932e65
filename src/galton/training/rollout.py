"""Steps of N environments in pure JAX under one policy, as one scan."""

from collections.abc import Callable
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, Int, Key, PyTree

from galton import normalization
from galton.algorithms import Agent, Rollout, Scalars, actor_critic
from galton.envs.jax_task import JaxTask
from galton.policies.correlation import continued
from galton.training.log import Finished
from galton.types import Learner, Transition


class EpisodeState(NamedTuple):
    """N environments in the middle of their episodes."""

    env: PyTree[Array]
    """The environments' own states, each leaf `[N, ...]`."""
    length: Int[Array, " N"]
    """Steps taken so far in this episode."""
    undiscounted_return: Float[Array, " N"]
    """Reward collected so far in this episode."""
    noise: PyTree[Array] = ()
    """The z that the noise of the next actions goes on from, each leaf `[N, ...]`; () where noise is not correlated."""
    first: PyTree[Array] = ()
    """The first state of each copy's first episode, each leaf `[N, ...]`; () where its later ones begin elsewhere."""


def start_episodes(key: Key[Array, ""], task: JaxTask, n_envs: int) -> EpisodeState:
    """N environments at the start of an episode."""
    states = jax.vmap(task.record.reset)(jax.random.split(key, n_envs))
    return EpisodeState(states, jnp.zeros(n_envs, jnp.int32), jnp.zeros(n_envs))


class Noise(NamedTuple):
    """All that is random in a rollout, drawn before it: inside the scan that would cost more than the networks."""

    action: PyTree[Array]
    """The noise that the policy samples with, each leaf `[T, N, ...]`."""
    step: PyTree[Array]
    """The noise that the environments' steps need, each leaf `[T, N, ...]`."""
    fresh_states: PyTree[Array]
    """The next episode's first state should one end here, each leaf `[T, N, ...]`; of a pool, each leaf `[P, ...]`; ()
    where each copy begins again as it first did."""


def draw_noise(key: Key[Array, ""], task: JaxTask, agent: Agent) -> Noise:
    """Draw the noise of one rollout: T = n_steps steps of N = n_envs environments."""
    batch = (agent.rollout.n_steps, agent.rollout.n_envs)
    action_key, step_key, reset_key = jax.random.split(key, 3)
    return Noise(
        agent.policy.noise(action_key, batch),
        jax.vmap(jax.vmap(task.record.noise))(jax.random.split(step_key, batch)),
        _fresh_states(reset_key, task.record, agent.rollout),
    )


def _fresh_states(key: Key[Array, ""], env: Any, rollout: Rollout) -> PyTree[Array]:
    if rollout.resets == "first":
        return ()
    if rollout.resets == "pool":
        return jax.vmap(env.reset)(jax.random.split(key, rollout.reset_pool))
    return jax.vmap(jax.vmap(env.reset))(jax.random.split(key, (rollout.n_steps, rollout.n_envs)))


def _beginnings(noise: Noise, rollout: Rollout) -> tuple[Noise, Callable[[EpisodeState, PyTree[Array]], PyTree[Array]]]:
    """The noise of each step, and what makes of it and of the episodes the states where the next ones begin."""
    if rollout.resets == "first":
        return noise, lambda episodes, _: episodes.first
    if rollout.resets == "fresh":
        return noise, lambda _, fresh: fresh
    turn = jnp.arange(rollout.size).reshape(rollout.n_steps, rollout.n_envs) % rollout.reset_pool
    pool = noise.fresh_states
    return noise._replace(fresh_states=turn), lambda _, chosen: jax.tree.map(lambda x: x[chosen], pool)


Carry = tuple[EpisodeState, normalization.Normalizer]
"""The state that a rollout carries from step to step."""


def rollout(
    task: JaxTask, agent: Agent, learner: Learner, episodes: EpisodeState, noise: Noise
) -> tuple[EpisodeState, normalization.Normalizer, Transition, Finished, Scalars]:
    """T steps of each environment, reset where an episode ends; the normaliser's statistics grow on the way.

    The last is what the environments tell of themselves, each number's mean over the rollout.
    """
    env, (noise, beginning) = task.record, _beginnings(noise, agent.rollout)

    def observed(normalizer: normalization.Normalizer, states: PyTree[Array]) -> Array:
        return normalization.from_origin(normalizer, jax.vmap(task.observe)(states))

    def step(carry: Carry, noise: Noise) -> tuple[Carry, tuple[Transition, Finished, dict[str, Array]]]:
        episodes, normalizer = carry
        observation = normalization.observation(normalizer, observed(normalizer, episodes.env))
        explored, z = continued(
            agent.policy, noise.action, episodes.noise, episodes.length == 0, agent.rollout.noise_correlation
        )
        action = actor_critic.act(agent, learner.params, observation, explored)
        states, reward, terminated = jax.vmap(task.step)(episodes.env, action, noise.step)
        length, collected = episodes.length + 1, episodes.undiscounted_return + reward
        truncated = (length >= env.max_episode_steps) & ~terminated
        done = terminated | truncated
        following = EpisodeState(
            task.begun_anew(done, states, beginning(episodes, noise.fresh_states)),
            jnp.where(done, 0, length),
            jnp.where(done, 0.0, collected),
            z,
            episodes.first,
        )
        normalizer, reward, next_observation = normalization.receive(
            normalizer,
            reward,
            done,
            observed(normalizer, states),
            observed(normalizer, following.env),
            agent.algorithm.gamma,
            agent.rollout.normalize_window,
        )
        told = Transition(observation, action, reward, next_observation, terminated, truncated)
        return (following, normalizer), (told, Finished(done, collected, length), jax.vmap(task.metrics)(states))

    (episodes, normalizer), (transitions, finished, metrics) = jax.lax.scan(step, (episodes, learner.normalizer), noise)
    return episodes, normalizer, transitions, finished, jax.tree.map(jnp.mean, metrics)
