"""The scan against a loop that plays the same steps one by one, with the task written in numpy."""

import dataclasses
import functools

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from galton.algorithms import actor_critic
from galton.envs.jax_task import JaxTask
from galton.training.rollout import EpisodeState, draw_noise, rollout, start_episodes

from ..agents import agent as agent_in
from .slide import HIGH, LIMIT, LOW, START, Slide, slide

T, N = 20, 3


@pytest.fixture(scope="module")
def played():
    """An agent, who acted, and what came of it in episodes that are two steps old."""
    agent = agent_in({"loss": "gaussian", "n_steps": T, "n_envs": N, "net_arch": (8,)}, low=LOW, high=HIGH)
    learner = actor_critic.init(jax.random.key(0), agent, 3)
    noise = draw_noise(jax.random.key(1), JaxTask(Slide()), agent)
    fresh = start_episodes(jax.random.key(2), JaxTask(Slide()), N)
    old = EpisodeState(fresh.env.at[:, 2].set(0.25), fresh.length + 2, fresh.undiscounted_return + 5)
    program = jax.jit(functools.partial(rollout, JaxTask(Slide())))
    return agent, learner, noise, program(agent, learner, old, noise)


def close(found, expected):
    np.testing.assert_allclose(found, expected, rtol=1e-4, atol=1e-5)


def test_each_step_acts_on_what_it_sees_and_an_end_begins_anew(played):
    agent, learner, noise, answer = played
    noise, (episodes, _, batch, finished) = jax.tree.map(np.asarray, (noise, answer))
    act = jax.jit(functools.partial(actor_critic.act, agent))
    for n in range(N):
        env = slide()
        env.reset()
        env.unwrapped.state = np.array([*START[:2], 0.25], np.float32)
        env._elapsed_steps, length, collected = 2, 2, 5.0
        observation = env.unwrapped.state
        for t in range(T):
            action = np.asarray(act(learner.params, observation, noise.action[t, n]))
            close(batch.observation[t, n], observation)
            close(batch.action[t, n], action)
            following, reward, terminated, truncated, _ = env.step(np.clip(action, LOW, HIGH))
            length, collected = length + 1, collected + reward
            close(batch.next_observation[t, n], following)
            close(batch.reward[t, n], reward)
            assert (batch.terminated[t, n], batch.truncated[t, n]) == (terminated, truncated and not terminated)
            assert (finished.done[t, n], finished.length[t, n]) == (terminated or truncated, length)
            close(finished.undiscounted_return[t, n], collected)
            observation = following
            if terminated or truncated:
                observation, _ = env.reset()
                length, collected = 0, 0.0
        close(episodes.env[n], observation)
        assert episodes.length[n] == length
        close(episodes.undiscounted_return[n], collected)
    assert batch.terminated.any()
    assert batch.truncated.any()
    assert finished.length.max() == LIMIT
    assert ((batch.action < LOW) | (batch.action > HIGH)).any()


@dataclasses.dataclass(frozen=True)
class Ending(Slide):
    """A task that ends with its time."""

    def step(self, state, action, noise):
        following, reward, _ = super().step(state, action, noise)
        return following, reward, following[2] > 0.125 * LIMIT - 0.01


def test_a_step_that_ends_by_itself_at_the_time_limit_is_none_and_an_episode_begins_where_the_noise_says():
    agent = agent_in({"loss": "gaussian", "n_steps": 2 * LIMIT, "n_envs": 2, "net_arch": ()}, low=LOW, high=HIGH)
    task = JaxTask(Ending())
    starts = np.random.default_rng(0).uniform(-1, 1, (2 * LIMIT, 2, 3)).astype(np.float32) * [1, 1, 0]

    @jax.jit
    def run():
        learner = actor_critic.init(jax.random.key(0), agent, 3)
        noise = draw_noise(jax.random.key(1), task, agent)._replace(fresh_states=jnp.float32(starts))
        return rollout(task, agent, learner, start_episodes(jax.random.key(2), task, 2), noise)

    episodes, _, batch, finished = run()
    ends = np.arange(1, 2 * LIMIT + 1) % LIMIT == 0
    np.testing.assert_array_equal(batch.terminated, np.stack([ends, ends], 1))
    np.testing.assert_array_equal(finished.length[LIMIT - 1], [LIMIT, LIMIT])
    assert not batch.truncated.any()
    np.testing.assert_array_equal(batch.observation[LIMIT], np.float32(starts[LIMIT - 1]))
    np.testing.assert_array_equal(episodes.env, np.float32(starts[-1]))


@dataclasses.dataclass(frozen=True)
class Drawn(Slide):
    """A task whose steps need what a start is made of."""

    def reset(self, key):
        return jax.random.normal(key, (3,))

    def noise(self, key):
        return jax.random.normal(key, (3,))


def test_actions_steps_and_starts_are_drawn_apart():
    agent = agent_in({"loss": "gaussian", "n_steps": 6, "n_envs": 4, "net_arch": ()}, low=LOW, high=HIGH)
    noise = draw_noise(jax.random.key(0), JaxTask(Drawn()), agent)
    assert [leaf.shape for leaf in noise] == [(6, 4, 2), (6, 4, 3), (6, 4, 3)]
    together = np.concatenate([np.ravel(leaf) for leaf in noise])
    assert len(np.unique(together)) == together.size, "a key of its own for each step and copy"
