"""Figures show more than what was trained."""

import gymnasium
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from galton.envs.find import find
from galton.losses import LOSSES
from galton.tasks import TASKS
from studies.paper.why import draw

from . import made_up


@pytest.mark.parametrize("task", [task for task in TASKS if TASKS[task].in_jax and TASKS[task].at_rest is not None])
def test_what_doing_nothing_earns(task):
    env = find(TASKS[task].env).record
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


OUTSIDE_JAX = [
    (TASKS[task].env, TASKS[task].at_rest, n) for task, n in (("reacher", 200), ("half-cheetah", 10), ("ant", 10))
]
"""Environments, what doing nothing earns, and over how many episodes that is measured."""


@pytest.mark.parametrize(("name", "at_rest", "n_episodes"), [*OUTSIDE_JAX, ("Pendulum-v1", -1_210, 400)])
def test_what_doing_nothing_earns_outside_jax(name, at_rest, n_episodes):
    with gymnasium.make(name) as env:
        action, returns = np.zeros(env.action_space.shape), []
        for seed in range(n_episodes):
            env.reset(seed=seed)
            returns.append(0.0)
            over = False
            while not over:
                _, reward, terminated, truncated, _ = env.step(action)
                returns[-1] += reward
                over = terminated or truncated
    assert abs(np.mean(returns) - at_rest) <= 4 * np.std(returns) / n_episodes**0.5


def test_a_mean_far_below_all_others_is_written_down_and_does_not_stretch_the_axis():
    def final(name, setting):
        crashed = setting["loss"] == "gaussian" and setting["normalize_observation"]
        return -1_000.0 if crashed and name == "why-lqr-again" else -20.0 - 1_000 * setting["learning_rate"]

    names = ("why-lqr", "why-lqr-again")
    (axes,) = draw(made_up.data(final, names, budget="paper")).axes
    told = [text.get_text() for text in axes.texts]
    assert told == [" ↓ −1000 ± 0"] * 4  # that change alone and with all others, in training and deterministic
    low, high = axes.get_ylim()
    assert -30 < low < -26.03 < -9.77 < high


def test_so_is_a_mean_far_above_all_others():
    def final(name, setting):
        climbed = setting["loss"] == "gaussian" and setting["n_envs"] == 8 and setting["normalize_reward"]
        return 93.0 if climbed else -1_000 * setting["learning_rate"]

    names = ("why-mountain-car", "why-mountain-car-again")
    (axes,) = draw(made_up.data(final, names, budget="paper")).axes
    assert [text.get_text() for text in axes.texts] == [" ↑ 93 ± 0"] * 2
    assert axes.get_ylim()[1] < 5


def test_changes_stand_in_the_order_of_classification_and_losses_differ_by_shape():
    def final(name, setting):
        worst = setting["n_envs"] == 8 and setting["loss"] == "gaussian"
        ends = -20.0 if setting["gae_lambda"] == pytest.approx(0.95) else -25.0
        return ends + (setting["loss"] == "hl-one-hot") - (60 if worst else 0)

    (axes,) = draw(made_up.data(final, ("why-lqr", "why-lqr-again"), budget="paper")).axes
    changes = [label.get_text().replace("\n", " ") for label in axes.get_xticklabels()]
    assert changes[0] == "as in the main experiment"
    assert {"λ = 0.95", "λ = 0.95 and entropy bonus"} <= {*changes[-3:]}
    names = {str(line.get_gid()) for line in axes.get_lines()}
    assert {"Gaussian", "Gaussian: deterministic", "HL-Gauss: deterministic"} <= names
    shapes = {
        line.get_marker() for line in axes.get_lines() if line.get_gid() in {loss.label for loss in LOSSES.values()}
    }
    assert len(shapes) == len(LOSSES)
