"""A record of ours, stepped from Python, is the record."""

import jax
import jax.numpy as jnp
import numpy as np

from galton.envs.bandit import Bandit
from galton.envs.lqr import LQR
from galton.envs.on_host import RecordEnvironments

SEEDS = np.array([3, 7])


def test_steps_are_the_records_and_actions_are_clipped():
    env, action = LQR(), np.array([[0.3, -0.2], [5.0, 0.1]], np.float32)
    envs = RecordEnvironments(env)
    first = envs.reset(SEEDS)
    for i, seed in enumerate(SEEDS):
        state = env.reset(jax.random.key(seed))
        np.testing.assert_allclose(first[i], env.observe(state), rtol=1e-6)
    steps = envs.step(action)
    noise_key, _ = jax.random.split(jax.random.fold_in(jax.random.key(7), 1))
    state, reward, _ = env.step(state, jnp.array([1.0, 0.1]), env.noise(noise_key))
    np.testing.assert_allclose(steps.final_observation[1], env.observe(state), rtol=1e-6)
    np.testing.assert_allclose(steps.reward[1], reward, rtol=1e-6)
    np.testing.assert_array_equal(steps.observation, steps.final_observation)


def test_an_episode_is_cut_at_its_limit_and_another_begins():
    envs = RecordEnvironments(LQR(max_episode_steps=3))
    envs.reset(SEEDS)
    ends = [envs.step(np.zeros((2, 2), np.float32)) for _ in range(7)]
    assert [bool(steps.truncated.all()) for steps in ends] == [False, False, True, False, False, True, False]
    assert not any(steps.terminated.any() for steps in ends)
    assert (ends[2].observation != ends[2].final_observation).any(1).all()


def test_what_terminates_is_not_truncated():
    envs = RecordEnvironments(Bandit(d=2))
    envs.reset(SEEDS)
    steps = envs.step(np.zeros((2, 2), np.float32))
    assert steps.terminated.all()
    assert not steps.truncated.any()
