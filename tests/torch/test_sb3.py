"""Stable-Baselines3's programs train and keep the policies of galton.torch.sb3."""

import os

import gymnasium
import numpy as np
import pytest
import sb3_contrib
import stable_baselines3
import torch
from gymnasium.spaces import Box, Dict, Discrete
from stable_baselines3.common.env_util import make_vec_env
from stable_baselines3.common.vec_env import VecNormalize

import galton
from galton.torch.bins import _cached
from galton.torch.sb3 import HistogramPolicy, MultiInputHistogramPolicy

BINS = {"n_bins": 9, "eta": 1.0, "net_arch": [16]}


class Goal(gymnasium.Env):
    """It sees a dictionary, and pays for actions near what it shows."""

    observation_space = Dict(goal=Box(-1, 1, (2,)), time=Box(0, 1, (1,)))
    action_space = Box(np.float32([-1, -2]), np.float32([1, 2]))

    def reset(self, *, seed=None, options=None):
        super().reset(seed=seed)
        self.goal, self.t = self.np_random.uniform(-1, 1, 2).astype(np.float32), 0
        return self._seen(), {}

    def step(self, action):
        assert self.action_space.contains(action)
        self.t += 1
        return self._seen(), -float(np.abs(action / [1, 2] - self.goal).sum()), False, self.t == 5, {}

    def _seen(self):
        return {"goal": self.goal, "time": np.float32([self.t / 5])}


@pytest.mark.parametrize("algorithm", [stable_baselines3.A2C, stable_baselines3.PPO, sb3_contrib.TRPO])
def test_it_is_saved_and_loaded(algorithm, tmp_path):
    env = VecNormalize(make_vec_env("Pendulum-v1", 2, seed=0))
    model = algorithm(HistogramPolicy, env, n_steps=64, policy_kwargs=BINS, seed=0, device="cpu").learn(256)
    again = algorithm.load(model.save(tmp_path / "model.zip") or tmp_path / "model.zip", env=env)
    rows = np.random.default_rng(0).normal(size=(20, 3)).astype(np.float32)
    for ours, theirs in zip(*(one.predict(rows, deterministic=True) for one in (model, again)), strict=True):
        np.testing.assert_array_equal(ours, theirs)
    model.policy.save(tmp_path / "policy")
    policy = HistogramPolicy.load(tmp_path / "policy")
    np.testing.assert_array_equal(
        policy.predict(rows, deterministic=True)[0], model.predict(rows, deterministic=True)[0]
    )
    torch.testing.assert_close(policy.action_dist.words["eta"], 1.0)


def test_dictionaries_of_observations_and_unequal_bounds():
    words = BINS | {"loss": "hl-one-hot", "head_scale": 4.0, "initial_policy": "uniform"}
    model = stable_baselines3.PPO(
        MultiInputHistogramPolicy, make_vec_env(Goal, 4, seed=0), n_steps=64, policy_kwargs=words, seed=0, device="cpu"
    )
    before = stable_baselines3.common.evaluation.evaluate_policy(model, make_vec_env(Goal, 1, seed=1), 20)[0]
    model.learn(5_000)
    after = stable_baselines3.common.evaluation.evaluate_policy(model, make_vec_env(Goal, 1, seed=1), 20)[0]
    assert after > before + 1


def test_a_first_policy_is_the_one_that_was_asked_for():
    model = stable_baselines3.PPO(
        HistogramPolicy, "Pendulum-v1", policy_kwargs=BINS | {"initial_std": 0.25, "n_bins": 101}, device="cpu"
    )
    found = model.policy.get_distribution(torch.randn(50, 3)).distribution
    np.testing.assert_allclose(found.stddev.detach(), 0.5, rtol=0.05)  # a quarter of a half-width of 2


def test_actions_that_are_no_box_are_refused():
    with pytest.raises(galton.UsageError, match=r"has actions Discrete\(2\); bins are cut into a Box"):
        HistogramPolicy(Box(-1, 1, (3,)), Discrete(2), lambda _: 1e-3)


@pytest.mark.skipif("CHECKED" in os.environ, reason="the checker refuses 41.0 first")
def test_what_the_policy_can_not_do_is_refused_when_it_is_made():
    with pytest.raises(galton.UsageError, match="use_sde is True; a softmax has no state-dependent noise"):
        stable_baselines3.PPO(HistogramPolicy, "Pendulum-v1", use_sde=True)
    with pytest.raises(galton.UsageError, match=r"the number of bins is 41\.0; it must be an integer"):
        stable_baselines3.PPO(HistogramPolicy, "Pendulum-v1", policy_kwargs={"n_bins": 41.0})
    boxes = Dict(seen=Box(-1, 1, (3,)))
    with pytest.raises(galton.UsageError, match="take MultiInputHistogramPolicy"):
        HistogramPolicy(boxes, Box(-1, 1, (1,)), lambda _: 1e-3)


class Deterministic(torch.nn.Module):
    """What SB3's guide to exporting wraps a policy in."""

    def __init__(self, policy):
        super().__init__()
        self.policy = policy

    def forward(self, rows):
        return self.policy(rows, deterministic=True)[0]


@pytest.mark.filterwarnings("ignore")  # tracing warns of much, and of itself
def test_it_can_be_traced_before_it_has_computed_anything():
    _cached.cache_clear()
    policy = stable_baselines3.PPO(HistogramPolicy, "Pendulum-v1", policy_kwargs=BINS, device="cpu").policy
    _cached.cache_clear()
    rows = torch.randn(4, 3)
    traced = torch.jit.trace(Deterministic(policy).eval(), rows)
    torch.testing.assert_close(traced(rows), policy(rows, deterministic=True)[0])
