"""Environments in pure JAX as tasks, and stepped from Python."""

import dataclasses
import warnings

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from gymnasium.spaces import Discrete

import galton
from galton.envs.bandit import Bandit
from galton.envs.base import box
from galton.envs.find import find
from galton.envs.jax_task import JaxTask, RecordEnvironments
from galton.envs.lqr import LQR
from galton.errors import UsageError
from galton.training import on_device

SEEDS = np.array([3, 7])


def test_steps_are_the_records_and_actions_are_clipped():
    env, action = LQR(), np.array([[0.3, -0.2], [5.0, 0.1]], np.float32)
    envs = RecordEnvironments(JaxTask(env))
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


@pytest.mark.parametrize("kind", [jnp.array, list, tuple])
def test_bounds_may_be_arrays_of_any_kind(kind):
    class Own(LQR):
        action_low, action_high = (kind([np.float32(bound)] * 2) for bound in (-1, 1))
        observation_low, observation_high = (kind([np.float32(bound)] * 2) for bound in (-9, 9))

    task = find(Own())
    assert task.actions.box == JaxTask(LQR()).actions.box
    assert task.observations.space.high.tolist() == [9, 9]
    state, noise = task.record.reset(jax.random.key(0)), jnp.zeros(2)
    clipped, beyond = (task.step(state, jnp.array(action), noise)[0] for action in ([1.0, -1.0], [5.0, -5.0]))
    np.testing.assert_array_equal(clipped, beyond)


def test_an_episode_is_cut_at_its_limit_and_another_begins_and_what_terminates_is_not_truncated():
    envs = RecordEnvironments(JaxTask(LQR(max_episode_steps=3)))
    envs.reset(SEEDS)
    ends = [envs.step(np.zeros((2, 2), np.float32)) for _ in range(7)]
    assert [bool(steps.truncated.all()) for steps in ends] == [False, False, True, False, False, True, False]
    assert not any(steps.terminated.any() for steps in ends)
    assert (ends[2].observation != ends[2].final_observation).any(1).all()
    envs = RecordEnvironments(JaxTask(Bandit(d=2)))
    envs.reset(SEEDS)
    steps = envs.step(np.zeros((2, 2), np.float32))
    assert steps.terminated.all()
    assert not steps.truncated.any()


@dataclasses.dataclass(frozen=True)
class Aim:
    """One step: the reward is less than 0 by the distance from a target that the record holds, times a weight."""

    target: object
    weights: object = (1.0, 1.0)

    max_episode_steps = 1
    action_low, action_high = box(-1.0, 2), box(1.0, 2)
    observation_low, observation_high = box(0.0, 1), box(1.0, 1)
    optimal_return = random_return = None

    def reset(self, key):
        return jnp.ones(1)

    def noise(self, key):
        return ()

    def step(self, state, action, noise):
        return state, -(jnp.array(self.weights) * jnp.abs(action - jnp.array(self.target))).sum(), jnp.array(True)

    def observe(self, state):
        return state


@dataclasses.dataclass(frozen=True)
class Derived(Aim):
    """One that makes more of its fields than they are."""

    def __post_init__(self):
        object.__setattr__(self, "middle", sum(self.weights) / 2)


def test_a_record_with_more_than_fields_is_refused_where_it_is_made_anew_from_them():
    assert JaxTask(Derived((0.5, -0.5))).record.middle == 1.0
    with pytest.raises(UsageError, match=r"made anew from its fields, since it holds JAX.*; make middle a property"):
        JaxTask(Derived(jnp.zeros(2)))


@jax.tree_util.register_pytree_node_class
class Registered(Aim):
    """The same as a pytree, whose weights are a part of its structure."""

    def tree_flatten(self):
        return (self.target,), self.weights

    @classmethod
    def tree_unflatten(cls, weights, children):
        return cls(children[0], weights)


AGENT = galton.make_agent(loss="hl-one-hot", n_bins=5, n_steps=4, n_envs=2, net_arch=(4,))


@pytest.mark.slow
@pytest.mark.parametrize("kind", [Aim, Registered])
def test_arrays_of_a_record_are_arguments_of_its_programs(kind):
    """Records that differ in them share their programs, and learn what records of numbers learn."""
    targets = [(0.5, -0.5), (-1.0, 0.25)]
    compiled = on_device._compile.cache_info

    def trained(env):
        return galton.train(env, AGENT, [1, 2], 80, n_logs=2, n_eval_episodes=2)

    before = compiled().misses
    results = [trained(kind(jnp.array(target))) for target in targets]
    assert compiled().misses == before + 1
    for target, result in zip(targets, results, strict=True):
        fixed = trained(Aim(target))
        for ours, theirs in zip(jax.tree.leaves(result.learner), jax.tree.leaves(fixed.learner), strict=True):
            np.testing.assert_allclose(ours, theirs, rtol=1e-5, atol=1e-6)
    assert not np.array_equal(results[0].log.evaluation_return, results[1].log.evaluation_return)


def test_tasks_are_equal_where_their_records_are():
    held, tuples = (find(Aim(kind((0.5, -0.5)))) for kind in (jnp.array, tuple))
    assert held == find(Aim(jnp.array((0.5, -0.5))))
    assert held not in (tuples, find(Aim(jnp.array((0.5, 0.5)))), find(Aim(jnp.array((0.5, -0.5)), (1.0, 2.0))))
    assert tuples == find(Aim((0.5, -0.5)))
    assert tuples not in (find(Aim((0.5, 0.5))), JaxTask(Aim((0.5, -0.5)), 2.0), Aim((0.5, -0.5)))


@pytest.mark.parametrize("target", [[0.5, -0.5], np.array([0.5, -0.5])])
def test_a_record_that_holds_what_can_not_be_hashed_is_told_the_remedy(target):
    with pytest.raises(UsageError, match=r"env is Aim, a record whose structure can't be hashed, .*jax\.numpy makes"):
        find(Aim(target))


@dataclasses.dataclass(frozen=True)
class Counting(LQR):
    """It shows whole numbers, and its state holds the key of its own noise."""

    observation_low, observation_high = (np.full(2, bound, np.float32) for bound in (0, 255))
    observe_as = jnp.uint8

    def reset(self, key):
        return {"key": key, "x": jax.random.uniform(key, (2,), maxval=200.0)}

    def observe(self, state):
        return state["x"].astype(self.observe_as)

    def step(self, state, action, noise):
        own, following = jax.random.split(state["key"])
        x = jnp.clip(state["x"] + action + jax.random.normal(own, (2,)), 0, 200)
        return {"key": following, "x": x}, -x.sum(), x[0] < 1


@pytest.mark.parametrize("kind", [jnp.uint8, jnp.int32, bool])
def test_whole_numbers_are_normalised_as_numbers_and_keys_in_a_state_are_kept(kind, tmp_path):
    env = type("Counts", (Counting,), {"observe_as": kind})()
    words = {"loss": "gaussian", "n_steps": 8, "n_envs": 2, "net_arch": (4,), "normalize_observation": True}
    whole = galton.A2C(env, **words).learn(32, progress_bar=False)
    origin = np.asarray(whole.learner.normalizer.origin)
    seen = origin + whole.learner.normalizer.observation.mean
    assert origin.dtype == np.float32
    assert ((seen >= 0) & (seen <= 200)).all()
    path = galton.A2C(env, **words).learn(16, progress_bar=False).save(tmp_path / "model")
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        half = galton.A2C.load(path, env).learn(16, progress_bar=False)
    for ours, theirs in zip(jax.tree.leaves(half.learner), jax.tree.leaves(whole.learner), strict=True):
        np.testing.assert_array_equal(ours, theirs)


@dataclasses.dataclass(frozen=True)
class Masked(LQR):
    """Three values, of which so many entries say which are allowed; the first two always are."""

    n_entries: int = 3

    action_space = Discrete(3)

    def action_mask(self, state):
        return jnp.arange(self.n_entries) < 2

    def step(self, state, action, noise):
        return super().step(state, jnp.zeros(2) + action - 1, noise)


def test_a_mask_of_another_length_is_refused_before_training_and_an_entropy_can_not_be_held_beside_one():
    galton.A2C(Masked(), "hl-one-hot", n_bins=5, n_steps=5, net_arch=()).advance(1)
    for n in (1, 2, 4):
        with pytest.raises(UsageError, match=f"action mask has {n} entries; it must have one for each value of each"):
            galton.A2C(Masked(n_entries=n), "hl-one-hot", n_bins=5)
    with pytest.raises(UsageError, match="entropy_target is True; where a mask forbids actions"):
        galton.A2C(Masked(), "hl-one-hot", n_bins=5, entropy_target=True, normalize_advantage=True)
