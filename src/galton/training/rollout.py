"""Steps of N environments under one policy, as one scan."""

from typing import NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Key

from galton.algorithms import a2c
from galton.envs.base import Environment
from galton.policies import Policy
from galton.types import Config, EpisodeState, Params, Transition


class Finished(NamedTuple):
    """The episodes that ended in a rollout."""

    done: Bool[Array, "T N"]
    undiscounted_return: Float[Array, "T N"]
    """Of the episode so far; whole where done."""


def start_episodes(key: Key[Array, ""], env: Environment, n_envs: int) -> EpisodeState:
    """N environments at the start of an episode."""
    states = jax.vmap(env.reset)(jax.random.split(key, n_envs))
    return EpisodeState(states, jnp.zeros(n_envs, jnp.int32), jnp.zeros(n_envs))


def rollout(
    key: Key[Array, ""], env: Environment, policy: Policy, params: Params, episodes: EpisodeState, config: Config
) -> tuple[EpisodeState, Transition, Finished]:
    """T = n_steps steps of each environment, reset where an episode ends.

    All random numbers are drawn before the scan, in one go: inside it they would cost more than the networks.
    """
    batch = (config.n_steps, config.n_envs)
    action_key, step_key, reset_key = jax.random.split(key, 3)
    action_noise = policy.noise(action_key, batch)
    step_noise = jax.vmap(jax.vmap(env.noise))(jax.random.split(step_key, batch))
    fresh_states = jax.vmap(jax.vmap(env.reset))(jax.random.split(reset_key, batch))

    def step(episodes: EpisodeState, drawn: tuple[Array, Array, Array]) -> tuple[EpisodeState, tuple[Transition, Finished]]:
        action_noise, step_noise, fresh_states = drawn
        observation = jax.vmap(env.observe)(episodes.env)
        action = a2c.act(policy, params, observation, action_noise)
        clipped = jnp.clip(action, env.action_low, env.action_high)
        states, reward, terminated = jax.vmap(env.step)(episodes.env, clipped, step_noise)

        length = episodes.length + 1
        collected = episodes.undiscounted_return + reward
        truncated = (length >= env.max_episode_steps) & ~terminated
        done = terminated | truncated
        transition = Transition(
            observation, action, reward, jax.vmap(env.observe)(states), terminated, truncated
        )
        following = EpisodeState(
            jax.vmap(lambda d, fresh, state: jax.tree.map(lambda f, s: jnp.where(d, f, s), fresh, state))(
                done, fresh_states, states
            ),
            jnp.where(done, 0, length),
            jnp.where(done, 0.0, collected),
        )
        return following, (transition, Finished(done, collected))

    episodes, (transitions, finished) = jax.lax.scan(step, episodes, (action_noise, step_noise, fresh_states))
    return episodes, transitions, finished
