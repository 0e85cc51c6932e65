"""The scan against a loop that plays the same steps one by one, with the task in numpy; and where episodes begin."""

import dataclasses
import functools
import math

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from galton import A2C, UsageError
from galton.algorithms import actor_critic
from galton.envs import LQR
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
    noise, (episodes, _, batch, finished, _) = jax.tree.map(np.asarray, (noise, answer))
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

    episodes, _, batch, finished, _ = run()
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


SMALL = {"loss": "hl-one-hot", "n_bins": 5, "net_arch": (), "n_envs": 3, "n_steps": 7}
SHORT = 4


@dataclasses.dataclass(frozen=True)
class Told(LQR):
    """An LQR whose observation is where its episode began."""

    max_episode_steps: int = SHORT

    def reset(self, key):
        state = super().reset(key)
        return state, state

    def step(self, state, action, noise):
        now, first = state
        following, reward, terminated = super().step(now, action, noise)
        return (following, first), reward, terminated

    def observe(self, state):
        return state[1]


def starts(resets, n_updates, **own):
    """Where the episodes of each rollout began, `[updates, T, N, o]`."""
    model = A2C(Told(), resets=resets, **SMALL, **own)
    assert isinstance(model.env, JaxTask)
    found = []
    for _ in range(n_updates):
        model.advance(1)
        found.append(np.asarray(model.population._batch.observation)[0])
    return np.array(found), model


@pytest.mark.slow
def test_fresh_states_are_all_different_and_each_copy_may_begin_again_where_it_began():
    found, _ = starts("fresh", 4)
    assert len(np.unique(found.reshape(-1, 2), axis=0)) == 3 * (4 * 7 // SHORT)
    found, _ = starts("first", 4)
    assert len(np.unique(found.reshape(-1, 2), axis=0)) == 3
    np.testing.assert_array_equal(found, np.broadcast_to(found[:1, :1], found.shape))


@pytest.mark.slow
@pytest.mark.parametrize("size", [1, 2, 50])
def test_a_pool_has_as_many_states_for_each_rollout(size):
    found, model = starts("pool", 4, reset_pool=size)
    for i in range(4):
        begun = np.unique(found[i].reshape(-1, 2), axis=0)
        assert len(begun) <= 3 + 2 * size  # of episodes before it, of the last rollout's pool, and of its own
    key = jax.random.key(0)
    assert jax.tree.leaves(draw_noise(key, model.env, model.agent).fresh_states)[0].shape[0] == size


@pytest.mark.slow
@pytest.mark.parametrize("resets", ["pool", "first"])
def test_a_run_is_resumed_to_the_bit(resets, tmp_path):
    whole = A2C(Told(), resets=resets, **SMALL).learn(84, progress_bar=False)
    half = A2C(Told(), resets=resets, **SMALL).learn(42, progress_bar=False)
    again = A2C.load(half.save(tmp_path / "model"), Told()).learn(42, progress_bar=False)
    assert again.settings["resets"] == resets
    for ours, theirs in zip(jax.tree.leaves(whole.learner), jax.tree.leaves(again.learner), strict=True):
        np.testing.assert_array_equal(ours, theirs)


def test_a_pool_of_every_step_resets_as_often_as_fresh_states_and_no_more():
    def drawn(**own):
        agent = agent_in(SMALL | own, low=LOW, high=HIGH)
        shapes = jax.eval_shape(lambda: draw_noise(jax.random.key(0), JaxTask(Told()), agent).fresh_states)
        return sum(math.prod(leaf.shape[:-1]) for leaf in jax.tree.leaves(shapes)) // 2

    assert [drawn(), drawn(resets="pool", reset_pool=5), drawn(resets="first")] == [21, 5, 0]


def test_a_way_to_begin_that_has_no_use_is_refused():
    with pytest.raises(
        UsageError, match=r"^resets is 'pool', but Pendulum-v1 is no environment in JAX and resets itse"
    ):
        A2C("Pendulum-v1", "hl-gauss", resets="pool")
    with pytest.raises(UsageError, match=r"^reset_pool is 5; it has no use with resets at 'first'"):
        A2C("lqr", "hl-gauss", resets="first", reset_pool=5)
