"""The return of the policy that does not explore."""

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, Key, PyTree

from galton.algorithms import a2c
from galton.envs.base import Environment
from galton.policies import Policy
from galton.training.rollout import start_episodes
from galton.types import Params

Carry = tuple[PyTree[Array], Array, Array, Array]
"""States, returns so far, which episodes still run, and the step."""


def evaluate(
    key: Key[Array, ""], env: Environment, policy: Policy, params: Params, n_episodes: int
) -> Float[Array, " n_episodes"]:
    """Undiscounted returns of whole episodes under the deterministic action, stepped side by side."""
    reset_key, step_key = jax.random.split(key)
    start = start_episodes(reset_key, env, n_episodes)
    noise = jax.vmap(jax.vmap(env.noise))(jax.random.split(step_key, (env.max_episode_steps, n_episodes)))

    def running(carry: Carry) -> Array:
        _, _, active, t = carry
        return active.any() & (t < env.max_episode_steps)

    def step(carry: Carry) -> Carry:
        states, returns, active, t = carry
        distribution = a2c.distribution(policy, params, jax.vmap(env.observe)(states))
        action = jnp.clip(distribution.deterministic_action(), env.action_low, env.action_high)
        states, reward, terminated = jax.vmap(env.step)(states, action, jax.tree.map(lambda x: x[t], noise))
        return states, returns + jnp.where(active, reward, 0.0), active & ~terminated, t + 1

    first = (start.env, start.undiscounted_return, jnp.ones(n_episodes, bool), jnp.int32(0))
    return jax.lax.while_loop(running, step, first)[1]
