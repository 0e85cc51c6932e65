"""What stands in the figures besides what was trained."""

import gymnasium
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from galton.envs.find import find
from galton.paper.why import draw
from galton.tasks import TASKS

from . import made_up


@pytest.mark.parametrize("task", [task for task in TASKS if TASKS[task].in_jax and TASKS[task].at_rest is not None])
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
    assert abs(returns.mean() - TASKS[task].at_rest) <= 4 * returns.std() / n_episodes**0.5


@pytest.mark.parametrize(("task", "n_episodes"), [("reacher", 200), ("half-cheetah", 10), ("ant", 10)])
def test_what_doing_nothing_earns_in_mujoco(task, n_episodes):
    with gymnasium.make(TASKS[task].env) as env:
        action, returns = np.zeros(env.action_space.shape), []
        for seed in range(n_episodes):
            env.reset(seed=seed)
            returns.append(0.0)
            over = False
            while not over:
                _, reward, terminated, truncated, _ = env.step(action)
                returns[-1] += reward
                over = terminated or truncated
    assert abs(np.mean(returns) - TASKS[task].at_rest) <= 4 * np.std(returns) / n_episodes**0.5


def test_a_mean_far_below_all_others_is_written_down_and_does_not_stretch_the_axis():
    def final(name, setting):
        crashed = setting.config.loss == "gaussian" and setting.config.normalize_observation
        return -1_000.0 if crashed and name == "why-lqr-again" else -20.0 - 1_000 * setting.hypers.learning_rate

    names = ("why-lqr", "why-lqr-again")
    (axes,) = draw(made_up.data(final, names, budget="paper")).axes
    assert [text.get_text() for text in axes.texts] == [" ↓ −1000 ± 0"] * 2  # that change alone, and with all others
    low, high = axes.get_ylim()
    assert -30 < low < -26.03 < -9.77 < high
