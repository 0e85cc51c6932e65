"""What stands in the figures besides what was trained."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from galton.envs.find import find
from galton.studies.measures import AT_REST
from galton.studies.sweeps import TASKS


@pytest.mark.parametrize("task", AT_REST)
def test_what_doing_nothing_earns(task):
    env = find(TASKS[task].env)
    n_episodes = 2_000 if task == "lqr" else 20

    def episode(key):
        def step(carry, key):
            state, alive, total = carry
            state, reward, terminated = env.step(state, jnp.zeros(env.action_low.shape), env.noise(key))
            return (state, alive & ~terminated, total + jnp.where(alive, reward, 0.0)), None

        keys = jax.random.split(key, 1 + env.max_episode_steps)
        (_, _, total), _ = jax.lax.scan(step, (env.reset(keys[0]), True, 0.0), keys[1:])
        return total

    returns = np.asarray(jax.vmap(episode)(jax.random.split(jax.random.key(0), n_episodes)), np.float64)
    assert abs(returns.mean() - AT_REST[task]) <= 4 * returns.std() / n_episodes**0.5
