"""What the log says of a policy, against its definitions worked out another way."""

import functools

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.special import softmax
from scipy.stats import norm
from stable_baselines3.common.utils import explained_variance

from galton import LOSSES
from galton.algorithms import actor_critic
from galton.critics import CRITICS
from galton.networks import mlp
from galton.training.diagnosis import diagnose
from galton.types import Transition

from ..agents import agent as agent_in

T, N, K = 6, 3, 8
LOW, HIGH = np.array([-1.0, 0.0], np.float32), np.array([1.0, 3.0], np.float32)
ETA = 0.7
WORDS = {"n_bins": K, "n_steps": T, "n_envs": N, "net_arch": (7, 5), "gamma": 0.9, "gae_lambda": 0.8, "eta": ETA}
update = jax.jit(lambda agent, *rest: agent.algorithm.update(agent, *rest))


@functools.cache
def program(loss, critic):
    """(seed, scale) → a learner, a batch and its diagnosis."""
    own = {} if critic == "squared-error" else {"n_value_bins": K, "normalize_reward": True}
    agent = agent_in(WORDS | {"loss": loss, "critic": critic} | own, low=LOW, high=HIGH)
    return agent, jax.jit(functools.partial(_setup, agent))


def setup(loss, seed=0, scale=3.0, critic="squared-error"):
    """A policy with peaks, a batch that it sampled and what is said of them."""
    agent, made = program(loss, critic)
    return agent, *made(seed, scale)


def _setup(agent, seed, scale):
    keys = jax.random.split(jax.random.key(seed), 8)
    learner = actor_critic.init(keys[0], agent, 4)
    learner = learner._replace(params=jax.tree.map(lambda x: x * scale, learner.params))
    learner.params["actor"][-1]["kernel"] *= 30
    observation = jax.random.normal(keys[1], (T, N, 4))
    action = actor_critic.act(agent, learner.params, observation, agent.policy.noise(keys[2], (T, N)))
    ends = jax.random.uniform(keys[3], (2, T, N)) < 0.2
    batch = Transition(
        observation,
        action,
        jax.random.normal(keys[4], (T, N)) - 2,
        jax.random.normal(keys[5], (T, N, 4)),
        ends[0],
        ends[1] & ~ends[0],
    )
    return learner, batch, diagnose(agent, learner, batch)


@pytest.mark.slow
@pytest.mark.parametrize("loss", LOSSES)
def test_the_gradient_never_crosses_its_bound_and_the_bound_is_not_idle(loss):
    for seed in range(20):
        for scale in (0.3, 3.0):
            *_, diagnosis = setup(loss, seed, scale)
            assert 0 < diagnosis["actor_grad_norm"] <= diagnosis["grad_bound"]
    assert diagnosis["grad_bound"] < 1000 * diagnosis["actor_grad_norm"]


@pytest.mark.few
@pytest.mark.parametrize("loss", LOSSES)
def test_the_gradient_is_that_of_the_update(loss):
    """The norm of the update's gradient over the same parameters, with the critic's and the entropy's part at zero."""
    agent, learner, batch, diagnosis = setup(loss)
    agent = agent.replace(
        algorithm=agent.algorithm.replace(vf_coef=0.0),
        optimizer=agent.optimizer.replace(max_grad_norm=1e9, learning_rate=0.0),
    )
    after, _ = update(agent, learner, batch, jax.random.key(0))
    first_moment = after.optimizer.mu["actor"]
    gradient = [np.ravel(leaf) / 0.1 for layer in first_moment[:-1] for leaf in layer.values()]
    gradient.append(np.ravel(first_moment[-1]["kernel"]) / 0.1)
    np.testing.assert_allclose(diagnosis["actor_grad_norm"], np.linalg.norm(np.concatenate(gradient)), rtol=1e-4)


@pytest.mark.few
@pytest.mark.parametrize("critic", CRITICS)
def test_explained_variance_is_sb3s_of_the_decoded_value(critic):
    agent, learner, batch, diagnosis = setup("gaussian", critic=critic)
    estimates = [np.asarray(mlp(learner.params["critic"], o)) for o in (batch.observation, batch.next_observation)]
    if critic == "squared-error":
        values, following = (each[..., 0] for each in estimates)
    else:
        low, high = agent.critic.value_min, agent.critic.value_max
        centers = low + (high - low) * (np.arange(K) + 0.5) / K
        values, following = (softmax(each, -1) @ centers for each in estimates)
    advantage = np.asarray(actor_critic.advantages(agent, jnp.ravel(values), jnp.ravel(following), batch))
    expected = explained_variance(values.ravel(), advantage + values.ravel())
    np.testing.assert_allclose(diagnosis["explained_variance"], expected, rtol=1e-3)


def test_sigma_is_the_gaussians_own_and_the_softmaxs_effective_one():
    _, learner, _, diagnosis = setup("gaussian")
    np.testing.assert_allclose(diagnosis["sigma"], np.exp(learner.params["log_std"]).mean(), rtol=1e-6)
    agent, learner, batch, diagnosis = setup("hl-gauss")
    probs = np.asarray(actor_critic.distribution(agent, learner.params, batch.observation).probs, np.float64)
    centers = np.asarray(agent.policy.bins.centers, np.float64)
    variance = (probs * centers**2).sum(-1) - (probs * centers).sum(-1) ** 2
    np.testing.assert_allclose(diagnosis["sigma"], np.sqrt(variance).mean(), rtol=1e-4)


def test_edge_share_counts_the_outermost_bins_or_what_is_clipped():
    agent, _, batch, diagnosis = setup("hl-gauss")
    index = np.asarray(agent.policy.bins.encode(batch.action))
    assert 0 < diagnosis["edge_share"] < 1
    np.testing.assert_allclose(diagnosis["edge_share"], np.isin(index, [0, K - 1]).mean(), rtol=1e-6)
    _, _, batch, diagnosis = setup("gaussian")
    outside = (np.asarray(batch.action) < LOW) | (np.asarray(batch.action) > HIGH)
    assert 0 < diagnosis["edge_share"] < 1
    np.testing.assert_allclose(diagnosis["edge_share"], outside.mean(), rtol=1e-6)


@pytest.mark.few
@pytest.mark.parametrize("loss", sorted(LOSSES, key=lambda loss: loss != "hl-gauss"))
def test_the_bias_is_hl_gausss_alone_and_its_closed_form(loss):
    agent, learner, batch, diagnosis = setup(loss)
    if loss != "hl-gauss":
        assert diagnosis["hl_gauss_bias"] == 0
        return
    cdf = norm.cdf((np.arange(K + 1) - (np.arange(K)[:, None] + 0.5)) / ETA)
    table = np.diff(cdf) / (cdf[:, -1:] - cdf[:, :1])
    probs = np.asarray(actor_critic.distribution(agent, learner.params, batch.observation).probs, np.float64)
    values = (mlp(learner.params["critic"], o)[..., 0].ravel() for o in (batch.observation, batch.next_observation))
    advantage = np.asarray(actor_critic.advantages(agent, *values, batch))
    expected = abs(advantage.mean()) * np.linalg.norm(probs @ table - probs, axis=-1).mean()
    np.testing.assert_allclose(diagnosis["hl_gauss_bias"], expected, rtol=1e-4)
