"""A single run is split over devices: copies of the environment on each, and every gradient is that of all."""

import jax
import numpy as np
import pytest

import galton
from galton.training.population import populate

DEVICES = jax.devices()
WORDS = {"n_envs": 8, "n_steps": 16, "net_arch": (16,), "normalize_observation": True, "normalize_reward": True}
PPO = {"algorithm": "ppo", "batch_size": 32, "n_epochs": 2}


def trained(words, devices, n_updates=3):
    population = populate("lqr", galton.make_agent(**WORDS | words), [0], devices)
    population.advance(n_updates)
    return population


@pytest.mark.skipif(len(DEVICES) < 2, reason="JAX sees a single device here")
@pytest.mark.parametrize("words", [{"loss": "gaussian"}, PPO | {"loss": "hl-gauss-centred", "n_bins": 11}])
def test_copies_on_several_devices_learn_as_on_one(words):
    alone, split = (trained(words, devices, 1) for devices in (DEVICES[:1], DEVICES[:2]))
    for leaf in jax.tree.leaves(split._state.episodes.env):
        assert [shard.data.shape[1] for shard in leaf.addressable_shards] == [4, 4]
    for ours, theirs in zip(jax.tree.leaves(split.learner), jax.tree.leaves(alone.learner), strict=True):
        np.testing.assert_allclose(ours, theirs, rtol=1e-5, atol=1e-6)
    for name, value in split.log().columns().items():
        np.testing.assert_allclose(
            value, alone.log(begin_next=False).columns()[name], rtol=1e-3, atol=1e-4, err_msg=name
        )
    np.testing.assert_allclose(split.evaluate(4), alone.evaluate(4), rtol=1e-3)


@pytest.mark.skipif(len(DEVICES) < 2, reason="JAX sees a single device here")
def test_a_split_run_goes_on_exactly_and_on_one_device_too():
    words = PPO | {"loss": "gaussian", "resets": "first"}
    whole, half = trained(words, DEVICES[:2], 4), trained(words, DEVICES[:2], 2)
    for devices, tolerance in ((DEVICES[:2], 0), (DEVICES[:1], 1e-4)):
        again = populate("lqr", galton.make_agent(**WORDS | words), [5], devices)
        again.restore(half.snapshot())
        again.advance(2)
        for ours, theirs in zip(jax.tree.leaves(again.learner), jax.tree.leaves(whole.learner), strict=True):
            np.testing.assert_allclose(ours, theirs, rtol=tolerance, atol=tolerance / 10)
