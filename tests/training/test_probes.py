"""Does each part of the machine learn the one thing it has to?"""

import jax.numpy as jnp
import numpy as np
import pytest

from galton import LOSSES, make_agent, train
from galton.agents import read
from galton.algorithms import actor_critic
from galton.critics import CRITICS

from ..agents import agent
from .probes import Probe

pytestmark = pytest.mark.slow
FAST = {"n_steps": 8, "n_envs": 2, "net_arch": (32,), "learning_rate": 3e-3}


@pytest.fixture(params=CRITICS)
def critic(request):
    return request.param


OF_PPO = {"algorithm": "ppo", "n_steps": 32, "batch_size": 32, "n_epochs": 4}


def values_after(env, critic, steps=40_000, gamma=0.9, own=()):
    words = FAST | {"loss": "gaussian", "critic": critic, "gamma": gamma} | dict(own)
    words |= {} if critic == "squared-error" else {"value_min": -8.0, "value_max": 7.0}
    result = train(env, read(words), [0], steps, n_logs=5, n_eval_episodes=2)
    params = {"critic": [{name: x[0] for name, x in layer.items()} for layer in result.learner.params["critic"]]}
    return np.asarray(actor_critic.value(agent(words), params, jnp.array([[-1.0], [1.0]])))


def test_the_critic_learns_a_constant(critic):
    np.testing.assert_allclose(values_after(Probe("constant"), critic), 1.0, atol=0.05)


@pytest.mark.parametrize("own", [{}, OF_PPO], ids=["a2c", "ppo"])
def test_the_critic_sees_the_observation(critic, own):
    np.testing.assert_allclose(values_after(Probe("coin"), critic, own=own), [-1.0, 1.0], atol=0.05)


def test_the_critic_discounts_what_comes_a_step_later(critic):
    # Half the visits are one step before the reward, worth γ coin, half at it, worth the coin.
    expected = np.array([-1.0, 1.0]) * (1 + 0.5) / 2
    np.testing.assert_allclose(values_after(Probe("delayed", 2), critic, gamma=0.5), expected, atol=0.08)


def test_a_termination_is_worth_nothing_and_a_time_limit_what_follows(critic):
    # Reward 1 a step, five steps an episode: cut by the time limit the value is 1 / (1 − γ) all the same.
    cut = values_after(Probe("constant", 5, terminates=False), critic, steps=120_000, gamma=0.8)
    np.testing.assert_allclose(cut, 5.0, atol=0.2)
    ended = values_after(Probe("constant", 5, terminates=True), critic, steps=120_000, gamma=0.8)
    by_step = [sum(0.8**i for i in range(left)) for left in (5, 4, 3, 2, 1)]
    np.testing.assert_allclose(ended, np.mean(by_step), atol=0.2)


@pytest.mark.parametrize("loss", LOSSES)
def test_the_actor_learns_to_answer_the_observation(loss):
    agent = make_agent(loss=loss, n_bins=15, **FAST)
    result = train(Probe("action"), agent, range(6), 40_000, n_logs=10, n_eval_episodes=32)
    assert np.median(result.final("evaluation_return")) > -0.1
    assert np.median(result.final("training_return")) > np.median(result.log.training_return[:, 0])
