"""Stable-Baselines3's side of the comparisons: an environment that writes its steps down, weights, rollouts."""

import gymnasium
import jax
import jax.numpy as jnp
import numpy as np
import torch
from gymnasium.spaces import Box, MultiDiscrete
from stable_baselines3.common.vec_env import DummyVecEnv

from galton import Bins
from galton.types import Transition

LOW, HIGH, K = np.array([-1.0, 0.0]), np.array([1.0, 3.0]), 12
TIME_LIMIT = 7


class Recorder(gymnasium.Env):
    """Random observations; every other episode terminates, the rest meet the time limit. It writes down each step."""

    def __init__(self, discrete, space=None, n_mask=0):
        self.observation_space = Box(-np.inf, np.inf, (3,))
        self.action_space = MultiDiscrete([K, K]) if discrete else Box(LOW.astype("f4"), HIGH.astype("f4"))
        self.decodes, self.action_space = space is None and discrete, space or self.action_space
        self.bins, self.n_mask = Bins(LOW, HIGH, K), n_mask
        self.log = []
        self.episode = 0

    def reset(self, *, seed=None, options=None):
        super().reset(seed=seed)
        self.t = 0
        self.episode += 1
        self.observation = self._observed()
        return self.observation, {}

    def _observed(self):
        """The next observation; the mask that goes with it is kept."""
        if self.n_mask:
            self.mask = self.np_random.random(self.n_mask) < 0.5
            self.mask[[0, -1]] = True
        return self.np_random.normal(size=3).astype(np.float32)

    def action_masks(self):
        return self.mask

    def step(self, action):
        if self.decodes:
            action = self.bins.centers[np.arange(2), action]
        self.t += 1
        before = np.append(self.observation, self.mask).astype(np.float32) if self.n_mask else self.observation
        following = self._observed()
        reward = float(np.float32(2 * np.sum(action) - self.observation.sum() + self.np_random.normal()))
        terminated = self.t == 3 and self.episode % 2 == 0
        truncated = self.t == TIME_LIMIT and not terminated
        after = np.append(following, np.ones(self.n_mask, np.float32)) if self.n_mask else following
        self.log.append((before, reward, after, terminated, truncated))
        self.observation = following
        return following, reward, terminated, truncated, {}


def vector_of(envs):
    """SB3's vector environment of these."""
    return DummyVecEnv([lambda env=env: env for env in envs])


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
    if "log_std" in dict(policy.named_parameters()):
        params["log_std"] = policy.log_std.detach().numpy().copy()
    return params


def record_batch(model, envs, discrete):
    """Let SB3 collect a rollout; return what happened as our Transition `[T, N]`."""
    for env in envs:
        env.log.clear()
    n_steps, n_envs = model.n_steps, len(envs)
    model.collect_rollouts(model.env, model._init_callback(None), model.rollout_buffer, n_steps)
    actions = model.rollout_buffer.actions.reshape(n_steps, n_envs, -1)
    if discrete and envs[0].decodes:
        actions = np.asarray(envs[0].bins.decode(jnp.asarray(actions.astype(int))))
    columns = [np.stack([np.array([step[i] for step in env.log]) for env in envs], axis=1) for i in range(5)]
    observation, reward, following, terminated, truncated = columns
    batch = Transition(
        observation, actions.astype(np.float32), reward.astype(np.float32), following, terminated, truncated
    )
    return jax.tree.map(jnp.asarray, batch)


def relative_error(ours, theirs):
    """The largest over parameter arrays of ‖ours − theirs‖ / ‖theirs‖."""
    pairs = zip(jax.tree.leaves(ours), jax.tree.leaves(theirs), strict=True)
    return max(float(np.linalg.norm(a - b) / np.linalg.norm(b)) for a, b in pairs)
