"""Our updates against those of Stable-Baselines3's A2C (torch, Adam), from equal weights and recorded batches."""

import gymnasium
import jax
import jax.numpy as jnp
import numpy as np
import pytest
import stable_baselines3
import torch
from gymnasium.spaces import Box, MultiDiscrete

from galton import Bins, Config, Hypers
from galton.algorithms import a2c, actor_critic, resolve
from galton.types import Transition

LOW, HIGH, K = np.array([-1.0, 0.0]), np.array([1.0, 3.0]), 12
T, N, TIME_LIMIT = 10, 2, 7
HYPERS = Hypers(learning_rate=1e-3, gamma=0.97, gae_lambda=0.9, vf_coef=0.4, ent_coef=0.01, max_grad_norm=0.5)


class Recorder(gymnasium.Env):
    """Random observations; every other episode terminates, the rest meet the time limit. It writes down each step."""

    def __init__(self, discrete):
        self.observation_space = Box(-np.inf, np.inf, (3,))
        self.action_space = MultiDiscrete([K, K]) if discrete else Box(LOW.astype("f4"), HIGH.astype("f4"))
        self.bins = Bins(LOW, HIGH, K)
        self.log = []
        self.episode = 0

    def reset(self, *, seed=None, options=None):
        super().reset(seed=seed)
        self.t = 0
        self.episode += 1
        self.observation = self.np_random.normal(size=3).astype(np.float32)
        return self.observation, {}

    def step(self, action):
        if isinstance(self.action_space, MultiDiscrete):
            action = self.bins.centers[np.arange(2), action]
        self.t += 1
        following = self.np_random.normal(size=3).astype(np.float32)
        reward = float(np.float32(2 * action.sum() - self.observation.sum() + self.np_random.normal()))
        terminated = self.t == 3 and self.episode % 2 == 0
        truncated = self.t == TIME_LIMIT and not terminated
        self.log.append((self.observation, reward, following, terminated, truncated))
        self.observation = following
        return following, reward, terminated, truncated, {}


def sb3_model(discrete, normalize_advantage):
    envs = [Recorder(discrete) for _ in range(N)]
    vector = stable_baselines3.common.vec_env.DummyVecEnv([lambda env=env: env for env in envs])
    model = stable_baselines3.A2C(
        "MlpPolicy",
        vector,
        learning_rate=HYPERS.learning_rate,
        n_steps=T,
        gamma=HYPERS.gamma,
        gae_lambda=HYPERS.gae_lambda,
        ent_coef=HYPERS.ent_coef,
        vf_coef=HYPERS.vf_coef,
        max_grad_norm=HYPERS.max_grad_norm,
        use_rms_prop=False,
        normalize_advantage=normalize_advantage,
        seed=3,
        device="cpu",
    )
    model._setup_learn(10_000, None)
    return model, envs


def params_of(model):
    """SB3's weights in our structure."""
    policy = model.policy

    def layers(hidden, last):
        linear = [layer for layer in hidden if isinstance(layer, torch.nn.Linear)] + [last]
        return [
            {"kernel": layer.weight.detach().numpy().T.copy(), "bias": layer.bias.detach().numpy().copy()}
            for layer in linear
        ]

    extractor = policy.mlp_extractor
    params = {
        "actor": layers(extractor.policy_net, policy.action_net),
        "critic": layers(extractor.value_net, policy.value_net),
    }
    if hasattr(policy, "log_std"):
        params["log_std"] = policy.log_std.detach().numpy().copy()
    return params


def record_batch(model, envs, discrete):
    """Let SB3 collect a rollout; return what happened as our Transition [T, N]."""
    for env in envs:
        env.log.clear()
    model.collect_rollouts(model.env, model._init_callback(None), model.rollout_buffer, T)
    actions = model.rollout_buffer.actions.reshape(T, N, 2)
    if discrete:
        actions = np.asarray(envs[0].bins.decode(jnp.asarray(actions.astype(int))))
    columns = [np.stack([np.array([step[i] for step in env.log]) for env in envs], axis=1) for i in range(5)]
    observation, reward, following, terminated, truncated = columns
    batch = Transition(observation, actions, reward.astype(np.float32), following, terminated, truncated)
    return jax.tree.map(jnp.asarray, batch)


def relative_error(ours, theirs):
    """The largest over parameter arrays of ‖ours − theirs‖ / ‖theirs‖."""
    pairs = zip(jax.tree.leaves(ours), jax.tree.leaves(theirs), strict=True)
    return max(float(np.linalg.norm(a - b) / np.linalg.norm(b)) for a, b in pairs)


@pytest.mark.parametrize("normalize_advantage", [False, True])
@pytest.mark.parametrize("loss", ["gaussian", "hl-one-hot"])
def test_updates_equal_sb3s(loss, normalize_advantage):
    discrete = loss == "hl-one-hot"
    model, envs = sb3_model(discrete, normalize_advantage)
    config = Config(loss=loss, n_bins=K, n_steps=T, n_envs=N, normalize_advantage=normalize_advantage)
    agent = resolve(config, LOW, HIGH)
    start = jax.tree.map(jnp.asarray, params_of(model))
    learner = actor_critic.init(jax.random.key(0), agent, HYPERS, 3)._replace(params=start)
    update = jax.jit(lambda learner, batch: a2c.update(agent, learner, batch, HYPERS, jax.random.key(1))[0])

    for i in range(20):
        batch = record_batch(model, envs, discrete)
        assert batch.terminated.any()
        assert batch.truncated.any()
        model.train()
        learner = update(learner, batch)
        if i == 0:
            theirs = params_of(model)
            change = jax.tree.map(np.subtract, theirs, start)
            assert all(np.abs(leaf).max() > 1e-4 for leaf in jax.tree.leaves(change))
            # An entry may be off by a ten-thousandth of Adam's step: where a gradient is near Adam's ε, rounding shows.
            jax.tree.map(lambda a, b: np.testing.assert_allclose(a, b, rtol=1e-5, atol=1e-7), learner.params, theirs)
    assert relative_error(learner.params, params_of(model)) < 1e-3


@pytest.mark.parametrize("loss", ["gaussian", "hl-one-hot"])
def test_values_entropy_and_log_prob_equal_sb3s(loss):
    discrete = loss == "hl-one-hot"
    model, envs = sb3_model(discrete, False)
    config = Config(loss=loss, n_bins=K, n_steps=T, n_envs=N)
    agent, params = resolve(config, LOW, HIGH), jax.tree.map(jnp.asarray, params_of(model))
    batch = record_batch(model, envs, discrete)
    buffer = model.rollout_buffer
    np.testing.assert_allclose(actor_critic.value(params, batch.observation), buffer.values, rtol=1e-4, atol=1e-6)
    distribution = actor_critic.distribution(agent, params, batch.observation, HYPERS)
    flat = torch.as_tensor(np.array(batch.observation).reshape(T * N, 3))
    _, log_prob, entropy = model.policy.evaluate_actions(flat, torch.as_tensor(buffer.actions.reshape(T * N, 2)))
    np.testing.assert_allclose(np.ravel(distribution.entropy()), entropy.detach(), rtol=1e-5)
    np.testing.assert_allclose(np.ravel(distribution.log_prob(batch.action)), log_prob.detach(), rtol=1e-5)
    loss_value = agent.loss.function(distribution, batch.action, HYPERS)
    np.testing.assert_allclose(np.ravel(loss_value), -log_prob.detach(), rtol=1e-5)
