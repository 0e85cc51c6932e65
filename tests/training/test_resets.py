"""Where episodes of environments in JAX begin: fresh states, a pool of them, or where each copy first began."""

import dataclasses

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from galton import A2C, UsageError
from galton.envs import LQR
from galton.envs.jax_task import JaxTask
from galton.training.rollout import draw_noise

SMALL = {"loss": "hl-one-hot", "n_bins": 5, "net_arch": (), "n_envs": 3, "n_steps": 7}
LIMIT = 4


@dataclasses.dataclass(frozen=True)
class Told(LQR):
    """An LQR whose observation is where its episode began."""

    max_episode_steps: int = LIMIT

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
    assert len(np.unique(found.reshape(-1, 2), axis=0)) == 3 * (4 * 7 // LIMIT)
    found, _ = starts("first", 4)
    assert len(np.unique(found.reshape(-1, 2), axis=0)) == 3
    np.testing.assert_array_equal(found, np.broadcast_to(found[:1, :1], found.shape))


@pytest.mark.slow
@pytest.mark.parametrize("size", [1, 2, 50])
def test_a_pool_has_as_many_states_for_each_rollout(size):
    found, model = starts("pool", 4, reset_pool=size)
    for rollout in range(4):
        begun = np.unique(found[rollout].reshape(-1, 2), axis=0)
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
        agent = A2C(Told(), **SMALL, **own).agent
        shapes = jax.eval_shape(lambda: draw_noise(jax.random.key(0), JaxTask(Told()), agent).fresh_states)
        return sum(int(jnp.prod(jnp.array(leaf.shape[:-1]))) for leaf in jax.tree.leaves(shapes)) // 2

    assert [drawn(), drawn(resets="pool", reset_pool=5), drawn(resets="first")] == [21, 5, 0]


def test_a_way_to_begin_that_has_no_use_is_refused():
    with pytest.raises(
        UsageError, match=r"^resets is 'pool', but Pendulum-v1 is no environment in JAX and resets itse"
    ):
        A2C("Pendulum-v1", "hl-gauss", resets="pool")
    with pytest.raises(UsageError, match=r"^reset_pool is 5; it has no use with resets at 'first'"):
        A2C("lqr", "hl-gauss", resets="first", reset_pool=5)
