"""The scan against a loop that plays the same steps one by one, with the task written in numpy."""

import dataclasses
import functools

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from galton.algorithms import actor_critic
from galton.envs import Bandit
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


def test_each_step_acts_on_what_it_sees_and_an_end_begins_anew(played):
    agent, learner, noise, (episodes, _, batch, finished) = played
    act = jax.jit(functools.partial(actor_critic.act, agent))
    for n in range(N):
        env = slide()
        env.reset()
        env.unwrapped.state = np.array([*START[:2], 0.25], np.float32)
        env._elapsed_steps, length, collected = 2, 2, 5.0
        observation = env.unwrapped.state
        for t in range(T):
            action = np.asarray(act(learner.params, jnp.asarray(observation), noise.action[t, n]))
            np.testing.assert_allclose(batch.observation[t, n], observation, rtol=1e-4, atol=1e-5)
            np.testing.assert_allclose(batch.action[t, n], action, rtol=1e-4, atol=1e-5)
            following, reward, terminated, truncated, _ = env.step(np.clip(action, LOW, HIGH))
            length, collected = length + 1, collected + reward
            np.testing.assert_allclose(batch.next_observation[t, n], following, rtol=1e-4, atol=1e-5)
            np.testing.assert_allclose(batch.reward[t, n], reward, rtol=1e-4, atol=1e-5)
            assert (batch.terminated[t, n], batch.truncated[t, n]) == (terminated, truncated and not terminated)
            assert (finished.done[t, n], finished.length[t, n]) == (terminated or truncated, length)
            np.testing.assert_allclose(finished.undiscounted_return[t, n], collected, rtol=1e-4)
            observation = following
            if terminated or truncated:
                observation, _ = env.reset()
                length, collected = 0, 0.0
        np.testing.assert_allclose(episodes.env[n], observation, rtol=1e-4, atol=1e-5)
        assert episodes.length[n] == length
        np.testing.assert_allclose(episodes.undiscounted_return[n], collected, rtol=1e-4, atol=1e-5)


def test_both_kinds_of_end_and_actions_beyond_the_box_were_among_them(played):
    *_, (_, _, batch, finished) = played
    assert batch.terminated.any()
    assert batch.truncated.any()
    assert int(finished.length.max()) == LIMIT
    assert ((batch.action < LOW) | (batch.action > HIGH)).any()


def test_a_step_that_ends_by_itself_at_the_time_limit_is_no_time_limit():
    @dataclasses.dataclass(frozen=True)
    class Ending(Slide):
        """A task that ends with its time."""

        def step(self, state, action, noise):
            following, reward, _ = super().step(state, action, noise)
            return following, reward, following[2] > 0.125 * LIMIT - 0.01

    agent = agent_in({"loss": "gaussian", "n_steps": LIMIT, "n_envs": 2, "net_arch": ()}, low=LOW, high=HIGH)
    learner = actor_critic.init(jax.random.key(0), agent, 3)
    task = JaxTask(Ending())
    noise, begun = draw_noise(jax.random.key(1), task, agent), start_episodes(jax.random.key(2), task, 2)
    *_, batch, finished = rollout(task, agent, learner, begun, noise)
    np.testing.assert_array_equal(batch.terminated.sum(0), [1, 1])
    np.testing.assert_array_equal(finished.length[-1], [LIMIT, LIMIT])
    assert not batch.truncated.any()


def test_an_episode_begins_where_the_noise_says():
    env = Slide(max_episode_steps=1)
    agent = agent_in({"loss": "gaussian", "n_steps": 4, "n_envs": 2, "net_arch": ()}, low=LOW, high=HIGH)
    noise = draw_noise(jax.random.key(0), JaxTask(env), agent)
    starts = jnp.arange(24.0).reshape(4, 2, 3)
    noise = noise._replace(fresh_states=starts)
    learner = actor_critic.init(jax.random.key(1), agent, 3)
    begun = start_episodes(jax.random.key(2), JaxTask(env), 2)
    episodes, _, batch, _ = rollout(JaxTask(env), agent, learner, begun, noise)
    np.testing.assert_array_equal(batch.observation[1:], starts[:-1])
    np.testing.assert_array_equal(episodes.env, starts[-1])


def test_actions_steps_and_starts_are_drawn_apart():
    @dataclasses.dataclass(frozen=True)
    class Drawn(Slide):
        """A task whose steps need what a start is made of."""

        def reset(self, key):
            return jax.random.normal(key, (3,))

        def noise(self, key):
            return jax.random.normal(key, (3,))

    agent = agent_in({"loss": "gaussian", "n_steps": 6, "n_envs": 4, "net_arch": ()}, low=LOW, high=HIGH)
    drawn = [np.ravel(leaf) for leaf in draw_noise(jax.random.key(0), JaxTask(Drawn()), agent)]
    together = np.concatenate(drawn)
    assert len(np.unique(together)) == together.size


def test_noise_has_a_key_of_its_own_for_each_step_and_copy():
    env = Bandit()
    agent = agent_in(
        {"loss": "hl-gauss", "n_steps": 6, "n_envs": 4, "net_arch": ()}, low=env.action_low, high=env.action_high
    )
    noise = draw_noise(jax.random.key(0), JaxTask(env), agent)
    assert noise.action.shape == (6, 4, 2)
    for leaf in (noise.action, *jax.tree.leaves(noise.step)):
        assert len(np.unique(leaf)) == leaf.size
