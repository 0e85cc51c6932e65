import collections

import jax
import jax.numpy as jnp
import numpy as np

from galton.training.log import Finished, nothing, summarise, tally

NAMES = ("grad_norm", "entropy")
FINISHED = Finished(
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
    nobody = FINISHED._replace(done=jnp.zeros((3, 2), bool))
    sums = nothing(NAMES)
    for finished, scalars in zip((FINISHED, nobody), told, strict=True):
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
    sums = tally(FINISHED._replace(done=jnp.zeros((3, 2), bool)), dict.fromkeys(NAMES, jnp.float32(1)))
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
