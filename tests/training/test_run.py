import collections

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from galton.algorithms import A2C
from galton.envs import LQR
from galton.schedules import Linear, Step
from galton.training.log import Finished, nothing, summarise, tally
from galton.training.run import begin, learn, read_log, restored, rollout_key, step_of, stored
from galton.types import Transition

from ..agents import agent

ENV = LQR()
WORDS = {"loss": "gaussian", "n_steps": 4, "n_envs": 2, "net_arch": (4,)}
BOX = {"low": ENV.action_low, "high": ENV.action_high}
AGENT = agent(WORDS, **BOX)
FINISHED = Finished(jnp.zeros((4, 2), bool), jnp.zeros((4, 2)), jnp.zeros((4, 2), jnp.int32))
learnt = jax.jit(learn)


def new(seed=0):
    return begin(AGENT, 2, jnp.uint32(seed))[0]


def update(run, batch, **numbers):
    return learnt(agent(WORDS, numbers, **BOX), run, run.learner.normalizer, batch, FINISHED)


def batch(scale=1.0):
    keys = jax.random.split(jax.random.key(0), 4)
    ends = jnp.zeros((4, 2), bool)
    observation, following, action = (jax.random.normal(key, (4, 2, 2)) for key in keys[:3])
    return Transition(observation, action, scale * jax.random.normal(keys[3], (4, 2)), following, ends, ends)


def bits(tree):
    return [np.asarray(leaf).tobytes() for leaf in jax.tree.leaves(tree)]


def numbers(key):
    return tuple(np.asarray(jax.random.key_data(key)).tolist())


def test_a_seed_is_a_run_with_keys_apart_for_training_evaluation_and_first_episodes():
    assert bits(stored(AGENT, new(1))) == bits(stored(AGENT, new(1)))
    assert bits(new(1).learner) != bits(new(2).learner)
    assert numbers(new(1).key) != numbers(new(2).key)
    run, episodes_key = begin(AGENT, 2, jnp.uint32(0))
    assert len({*map(numbers, (run.key, run.evaluation_key, episodes_key))}) == 3


def test_a_rollouts_key_does_not_depend_on_when_it_is_asked_for():
    run = new()
    later = run._replace(updates=jnp.int32(3))
    assert numbers(rollout_key(AGENT, run, 3)) == numbers(rollout_key(AGENT, later))
    assert numbers(rollout_key(AGENT, later)) == numbers(jax.random.fold_in(run.key, 24))  # its environment steps
    assert len({numbers(rollout_key(AGENT, run, ahead)) for ahead in range(10)}) == 10


def test_an_update_has_a_key_of_its_own():
    seen, rollouts, run = [], [], new()

    class Spy(A2C):
        def update(self, agent, learner, batch, key):
            seen.append(numbers(key))
            return learner, dict.fromkeys(self.scalars, jnp.zeros(()))

    agent = AGENT.replace(algorithm=Spy())
    for _ in range(3):
        rollouts.append(numbers(rollout_key(AGENT, run)))
        run = learn(agent, run, run.learner.normalizer, batch(), FINISHED)
    assert len({*seen, *rollouts}) == 6


def test_the_learning_rate_falls_to_zero_with_the_last_update_and_a_decayed_update_is_one_with_that_rate():
    decaying = AGENT.optimizer.replace(decay_steps=40.0)
    shares = [float(decaying.remaining(jnp.float32(step))) for step in (8, 16, 32, 40, 48)]
    np.testing.assert_allclose(shares, [0.8, 0.6, 0.2, 0.0, 0.0], atol=1e-6)
    assert float(AGENT.optimizer.remaining(jnp.float32(10**6))) == 1
    decayed = update(new(), batch(), learning_rate=1e-2, decay_steps=32.0)
    plain = update(new(), batch(), learning_rate=1e-2 * 24 / 32)
    for a, b in zip(jax.tree.leaves(decayed.learner), jax.tree.leaves(plain.learner), strict=True):
        np.testing.assert_allclose(a, b, rtol=1e-5, atol=1e-7)


def test_a_gradient_that_is_not_finite_is_flagged_once_and_nothing_is_learnt_from_there_on():
    run = update(new(), batch())
    assert (int(run.updates), int(run.diverged_at)) == (1, -1)
    sick = update(run, batch(jnp.inf))
    assert (int(sick.updates), int(sick.diverged_at)) == (2, 2)
    after = update(sick, batch())
    again = update(after, batch(jnp.nan))
    assert (int(again.updates), int(again.diverged_at)) == (4, 2)
    assert bits(again.learner.params) == bits(run.learner.params)
    assert bits(update(run, batch()).learner.params) != bits(run.learner.params)


@pytest.mark.parametrize("scale", [1.0, jnp.inf])
def test_a_log_empties_the_books_and_knows_nothing_of_a_diverged_run(scale):
    run = update(new(), batch(scale))
    run, log = jax.jit(read_log)(AGENT, run, batch())
    assert all(float(leaf) == 0 for leaf in jax.tree.leaves(run.tally))
    assert [*log.scalars][: len(AGENT.algorithm.scalars)] == list(AGENT.algorithm.scalars)
    values = np.array([*log.scalars.values(), log.n_episodes])
    assert np.isfinite(values).all() if scale == 1 else np.isnan(values).all()


def test_keys_survive_as_plain_numbers_and_counts_as_environment_steps():
    run = new(7)._replace(updates=jnp.int32(10**9), diverged_at=jnp.int32(3))
    kept = jax.tree.map(np.asarray, stored(AGENT, run))
    assert (int(kept.step), int(kept.diverged_at)) == (8 * 10**9, 24)
    back = restored(AGENT, kept)
    assert numbers(rollout_key(AGENT, back)) == numbers(rollout_key(AGENT, run))
    assert numbers(back.evaluation_key) == numbers(run.evaluation_key)
    assert (int(back.updates), int(back.diverged_at)) == (10**9, 3)


def test_schedules_go_on_beyond_32_bits():
    at = np.array([10**8, 10**9, 2 * 10**9])
    steps = step_of(AGENT, jnp.asarray(at, jnp.int32))
    np.testing.assert_allclose(steps, at * 8.0, rtol=1e-7)
    np.testing.assert_allclose(Linear(1.0, 0.0, 16e9)(steps), [0.95, 0.5, 0.0], atol=1e-6)
    optimizer = AGENT.optimizer.replace(decay_steps=16e9)
    np.testing.assert_allclose([float(optimizer.remaining(float(8 * n))) for n in at], [0.95, 0.5, 0.0], atol=1e-6)


NAMES = ("grad_norm", "entropy")
ENDED = Finished(
    jnp.array([[False, True], [True, False], [False, True]]),
    jnp.array([[1.0, 10.0], [4.0, 0.5], [2.0, -3.0]]),
    jnp.array([[1, 7], [2, 1], [1, 3]]),
)
"""Three episodes end: returns 10, 4 and −3, lengths 7, 2 and 3."""


def of_two_updates():
    told = (
        {"entropy": jnp.float32(1), "grad_norm": jnp.float32(3)},
        {"entropy": jnp.float32(2), "grad_norm": jnp.float32(5)},
    )
    nobody = ENDED._replace(done=jnp.zeros((3, 2), bool))
    sums = nothing(NAMES)
    for finished, scalars in zip((ENDED, nobody), told, strict=True):
        sums = jax.tree.map(jnp.add, sums, tally(finished, scalars))
    return sums


def test_a_log_has_means_over_the_episodes_that_ended_and_over_the_updates():
    log = summarise(of_two_updates(), NAMES, {"sigma": jnp.float32(0.5)})
    assert log.n_episodes == 3
    np.testing.assert_allclose(log.training_return, 11 / 3, rtol=1e-6)
    np.testing.assert_allclose(log.episode_length, 4)
    assert np.isnan(log.evaluation_return)
    assert dict(log.scalars) == {"grad_norm": 4, "entropy": 1.5, "sigma": 0.5}


def test_without_an_episode_its_return_and_length_are_not_known():
    sums = tally(ENDED._replace(done=jnp.zeros((3, 2), bool)), dict.fromkeys(NAMES, jnp.float32(1)))
    log = summarise(sums, NAMES, {})
    assert log.n_episodes == 0
    assert np.isnan([log.training_return, log.episode_length]).all()
    assert log.scalars["entropy"] == 1


def test_columns_are_everything_in_one_order_which_jax_keeps():
    names = ["training_return", "episode_length", "n_episodes", "evaluation_return", "grad_norm", "entropy", "sigma"]
    log = jax.jit(lambda sums: summarise(sums, NAMES, {"sigma": jnp.float32(0.5)}))(of_two_updates())
    assert list(log.columns()) == names
    assert list(jax.tree.map(np.asarray, log).columns()) == names
    assert isinstance(log.scalars, collections.OrderedDict)


def test_an_update_sees_the_policy_that_sampled_its_batch_where_the_policy_has_a_schedule():
    seen = []

    class Spy(A2C):
        def update(self, agent, learner, batch, key):
            seen.append((float(agent.policy.head_scale), float(agent.loss.eta)))
            return learner, dict.fromkeys(self.scalars, jnp.zeros(()))

    words = WORDS | {"loss": "hl-gauss", "head_scale": Step(1.0, 4.0, 8.0), "eta": Step(1.0, 2.0, 8.0)}
    scheduled = agent(words, **BOX).replace(algorithm=Spy())
    run = begin(scheduled, 2, jnp.uint32(0))[0]
    for _ in range(2):
        run = learn(scheduled, run, run.learner.normalizer, batch(), FINISHED)
    assert seen == [(1.0, 2.0), (4.0, 2.0)]
