"""The losses over bins stay what they learnt through many epochs of each rollout, where gradients are clipped."""

import math

import numpy as np
import pytest

import galton

MANY = {"n_envs": 64, "n_steps": 96, "batch_size": 192, "n_epochs": 16, "learning_rate": 1e-3, "clip_range": 0.3}
BINS = {"n_bins": 41, "bin_centers": "bounds", "initial_policy": "clipped-gaussian", "deterministic_action": "mean"}
LOSSES = {"hl-one-hot": {}, "hl-gauss-centred": {"eta": 2.0, "target_tails": "reflected"}}


@pytest.mark.slow
@pytest.mark.parametrize("loss", LOSSES)
def test_nothing_is_lost_again_in_512_steps_on_each_rollout(loss):
    words = MANY | BINS | LOSSES[loss] | {"head_scale": 4.0, "box_units": 1.0, "log_std_init": math.log(0.6)}
    agent = galton.make_agent(algorithm="ppo", loss=loss, normalize_observation=True, **words)
    result = galton.train("lqr", agent, range(3), 30 * 64 * 96, n_logs=15, n_eval_episodes=20)
    curves = np.asarray(result.log.evaluation_return)
    assert curves[:, 0].max() < -12  # the optimum is -9.77
    assert curves[:, -5:].mean(1).min() > -14
    assert np.asarray(result.log.scalars["approx_kl"]).max() < 1
