"""Records of environments that have Brax's protocol or gymnax's: what they carry, and where their arrays go."""

import dataclasses
import functools
import os
import sys
import types
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import galton
from galton.algorithms import actor_critic
from galton.envs import others
from galton.envs.brax_like import of_brax
from galton.envs.gymnax_record import Gymnax
from galton.envs.jax_task import JaxTask
from galton.training.rollout import draw_noise, rollout, start_episodes


@jax.tree_util.register_dataclass
@dataclasses.dataclass
class Data:
    """A physics engine's state, most of which every step computes anew."""

    position: Any
    velocity: Any
    force: Any
    """Computed from the others."""


@jax.tree_util.register_dataclass
@dataclasses.dataclass
class State:
    """A state of Brax's protocol."""

    pipeline_state: Any
    obs: Any
    reward: Any
    done: Any
    metrics: Any
    info: Any


class Cart:
    """A cart that is pushed; it may see a dictionary."""

    action_size = 1

    def __init__(self, of_dictionary=False):
        self.gains = jnp.array([0.1, 2.0])
        self.of_dictionary = of_dictionary

    def reset(self, rng):
        rng, own = jax.random.split(rng)
        return self._state(jax.random.uniform(own, (2,)), jnp.zeros(2), rng, jnp.int32(0))

    def step(self, state, action):
        rng, own = jax.random.split(state.info["rng"])
        data = state.pipeline_state
        velocity = data.velocity + self.gains[0] * action + 0.01 * jax.random.normal(own, (2,))
        return self._state(data.position + self.gains[0] * velocity, velocity, rng, state.info["steps"] + 1)

    def _state(self, position, velocity, rng, steps):
        obs = jnp.concatenate([position, velocity])
        seen = {"state": obs, "privileged_state": jnp.append(obs, steps)} if self.of_dictionary else obs
        metrics = {"fast": (abs(velocity) > 0.2).any().astype(float)}
        info = {"rng": rng, "steps": steps, "unused": jnp.zeros(1000)}
        data = Data(position, velocity, -self.gains[1] * position)
        return State(data, seen, -(position**2).sum(), (abs(position) > 2).any().astype(float), metrics, info)


def played(record, n=50):
    """The observations, rewards and ends of some steps, by the record."""
    state, told = record.reset(jax.random.key(3)), []
    first = record.observe(state)
    for action in jax.random.uniform(jax.random.key(4), (n, 1), minval=-1):
        state, reward, ended = record.step(state, action, record.noise(jax.random.key(0)))
        told.append((record.observe(state), reward, ended))
    return first, told


def test_steps_are_the_environments_own():
    env = Cart()
    state = env.reset(jax.random.key_data(jax.random.key(3)))
    first, told = played(of_brax(env, "cart", 100))
    np.testing.assert_array_equal(first, state.obs)
    step = jax.jit(env.step)
    for action, (observation, reward, ended) in zip(
        jax.random.uniform(jax.random.key(4), (50, 1), minval=-1), told, strict=True
    ):
        state = step(state, action)
        np.testing.assert_allclose(observation, state.obs, rtol=1e-5, atol=1e-6)
        np.testing.assert_allclose(reward, state.reward, rtol=1e-5, atol=1e-6)
        assert ended == (state.done > 0)


def test_a_step_carries_what_a_later_one_reads_and_no_more():
    record = of_brax(Cart(), "cart", 100)
    kept = jax.eval_shape(record.reset, jax.random.key(0))
    assert sorted(leaf.size for leaf in kept) == [1, 2, 2, 2, 4]  # metrics; position, velocity and key; observation
    with_steps = of_brax(Cart(of_dictionary=True), "cart", 100, observation="state")
    assert len(jax.eval_shape(with_steps.reset, jax.random.key(0))) == 7, "the count too, which an observation shows"


def test_arrays_are_arguments_of_programs_and_no_constants():
    task = JaxTask(of_brax(Cart(), "cart", 100))
    assert [leaf.shape for leaf in jax.tree.leaves(task)] == [(2,)]
    state = task.record.reset(jax.random.key(0))

    def moved(task, gains):
        other = jax.tree.unflatten(jax.tree.structure(task), [gains])
        return other.step(state, jnp.ones(1), ())[0]

    a, b = (jax.jit(moved)(task, jnp.array([gain, 2.0])) for gain in (0.1, 0.3))
    assert any(not np.array_equal(x, y) for x, y in zip(a, b, strict=True))


def test_observations_by_name():
    record = of_brax(Cart(of_dictionary=True), "cart", 100, observation="privileged_state")
    assert JaxTask(record).observations.size == 5
    with pytest.raises(galton.UsageError, match="observes a dictionary of privileged_state, state, and observation is"):
        of_brax(Cart(of_dictionary=True), "cart", 100)
    with pytest.raises(galton.UsageError, match="observation is 'state', and 'cart' observes an array; leave it out"):
        of_brax(Cart(), "cart", 100, observation="state")


@pytest.mark.parametrize("limit", [0, 2.5])
@pytest.mark.skipif("CHECKED" in os.environ, reason="the checker refuses 2.5 first")
def test_a_time_limit_that_is_none_is_refused(limit):
    with pytest.raises(galton.UsageError, match=f"max_episode_steps is {limit}; it must be an integer of at least 1"):
        of_brax(Cart(), "cart", limit)


def test_it_is_trained_on_with_its_metrics_in_the_log():
    model = galton.PPO(of_brax(Cart(), "cart", 20), n_envs=4, n_steps=32, batch_size=64, seed=0)
    assert model.agent.rollout.resets == "first"
    model.learn(256)
    agent = galton.make_agent(loss="gaussian", n_envs=4, n_steps=8, resets="pool")
    result = galton.train(of_brax(Cart(), "cart", 20), agent, [0, 1], 64, n_logs=2)
    fast = np.asarray(result.log.columns()["env_fast"])
    assert fast.shape == (2, 2)
    assert ((fast > 0) & (fast <= 1)).all()


def test_first_states_at_every_step_are_refused_where_they_are_slow():
    agent = galton.make_agent(loss="gaussian", n_envs=4, n_steps=8)
    with pytest.raises(
        galton.UsageError, match=r"resets is 'fresh', which would reset cart at each .* make resets 'first'"
    ):
        galton.train(of_brax(Cart(), "cart", 20), agent, [0], 64)


class Params(NamedTuple):
    """Constants as gymnax has them."""

    max_steps_in_episode: int = 7

    def replace(self, **others):
        return self._replace(**others)


class Walk:
    """A task of gymnax's protocol: a walk that ends beyond 2, and counts its steps."""

    def reset_env(self, key, params):
        del params
        x = jax.random.uniform(key)
        return x[None], (x, jnp.int32(0))

    def step_env(self, key, state, action, params):
        x, time = state[0] + action[0] + 0.1 * jax.random.normal(key), state[1] + 1
        done = (abs(x) > 2) | (time >= params.max_steps_in_episode)
        return x[None], (x, time), -abs(x), done, {}


def test_a_time_limit_is_told_from_an_end_and_its_last_observation_is_kept():
    record = Gymnax(Walk(), Params(), "walk", 7, 0, (1,), (-0.1,), (0.1,))
    task, agent = JaxTask(record), galton.make_agent(loss="gaussian", n_steps=40, n_envs=16)
    agent = agent.on(task.actions.box)
    learner_key, key = jax.random.split(jax.random.key(0))
    learner = actor_critic.init(learner_key, agent, task.observations.size)
    episodes = start_episodes(key, task, 16)
    _, _, batch, finished, _ = rollout(task, agent, learner, episodes, draw_noise(key, task, agent))
    assert batch.truncated.any()
    assert not (batch.truncated & batch.terminated).any()
    assert (finished.length[np.asarray(batch.truncated)] == 7).all()
    ended = np.asarray(batch.terminated | batch.truncated)[:-1]
    following, told = (np.asarray(x)[..., 0] for x in (batch.next_observation[:-1], batch.observation[1:]))
    np.testing.assert_array_equal(following[~ended], told[~ended])
    assert (following[ended] != told[ended]).all(), "the last observation of an episode is not the next one's first"
    assert (np.abs(np.asarray(batch.next_observation)[np.asarray(batch.terminated)]) > 2).all()


class Wages(Cart):
    """Every step pays 1, for ever."""

    def step(self, state, action):
        after = super().step(state, 0 * action)
        return dataclasses.replace(after, reward=jnp.ones(()), done=jnp.zeros(()))


def test_a_time_limit_takes_nothing_from_the_value():
    record = of_brax(Wages(), "wages", 10)
    words = {"n_envs": 8, "n_steps": 5, "gamma": 0.8, "learning_rate": 0.01, "net_arch": (16,), "resets": "first"}
    result = galton.train(record, galton.make_agent(loss="gaussian", **words), [0], 20_000, n_logs=1, n_eval_episodes=0)
    state = record.reset(jax.random.key(9))
    params, agent = jax.tree.map(lambda x: x[0], result.learner.params), result.agent.on(JaxTask(record).actions.box)
    value = actor_critic.value(agent, params, record.observe(state))
    np.testing.assert_allclose(value, 1 / (1 - 0.8), rtol=0.03)


def test_a_time_limit_of_gymnaxs_own_is_the_records(monkeypatch):
    discrete = type("Discrete", (), {"n": 2})

    class Walking(Walk):
        def action_space(self, params):
            return discrete()

    gymnax = types.SimpleNamespace(registered_envs=["Walk-v1"], make=lambda task: (Walking(), Params()))
    monkeypatch.setitem(sys.modules, "gymnax", gymnax)
    made = functools.partial(others._gymnax.__wrapped__, "Walk-v1")
    for told, limit in (({}, 7), ({"max_steps_in_episode": 5}, 5), ({"max_episode_steps": 9}, 9)):
        record = made(**told)
        assert record.max_episode_steps == record.params.max_steps_in_episode == limit


class Late(Cart):
    """Its steps tell more than its first state."""

    def step(self, state, action):
        after = super().step(state, action)
        return dataclasses.replace(after, metrics=after.metrics | {"distance": jnp.ones(())})


def test_a_state_that_steps_change_in_kind_is_refused():
    with pytest.raises(
        galton.UsageError, match=r"env is Late, whose state is .* after reset and .*distance.* after st"
    ):
        of_brax(Late(), "late", 20)
