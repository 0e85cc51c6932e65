"""Phases, regret and times until runs are back after a change, counted by hand, and what scipy makes of them."""

import numpy as np
import pytest
from scipy import stats

import galton
from galton.envs import DriftingBandit
from galton_experiments.analysis import dynamic_regret, phases, recoveries

STEPS = np.arange(10, 100, 10)
RETURNS = np.array(
    [
        [0.9, 0.9, 0.9, 0.1, 0.8, 0.9, 0.2, 0.9, 0.9],  # back after 20, then after 20
        [0.9, 0.9, 0.9, 0.1, 0.2, 0.9, 0.2, 0.2, 0.9],  # not before the change at 60, where it is luck; nor then
        [0.9, 0.9, 0.9, 0.9, 0.2, 0.3, 0.9, 0.2, 0.9],  # at once, both times
    ]
)


def test_times_are_counted_from_each_change_and_end_before_the_next():
    first, second = recoveries(RETURNS, STEPS, 30, 0.8)
    for found in (first, second):
        np.testing.assert_array_equal(np.sort(found._uncensored), [10, 20])
        np.testing.assert_array_equal(found._right, [20])


def test_a_curve_of_scipys_is_kaplan_and_meiers():
    survival = stats.ecdf(recoveries(RETURNS, STEPS, 30, 0.8)[1]).sf
    assert survival.evaluate(5) == 1
    assert survival.evaluate(15) == pytest.approx(2 / 3)
    assert survival.evaluate(25) == pytest.approx(1 / 3)


def test_a_change_behind_which_nothing_was_logged_has_no_entry():
    assert len(recoveries(RETURNS, STEPS, 80, 0.8)) == 1
    assert recoveries(RETURNS, STEPS, 95, 0.8) == []


def test_phases_have_the_log_points_between_changes():
    found = phases(np.stack([STEPS, -STEPS]), STEPS, 30)
    for phase, expected in zip(found, [[10, 20], [40, 50], [70, 80]], strict=True):
        np.testing.assert_array_equal(phase, [expected, np.negative(expected)])
    assert len(phases(RETURNS, STEPS, 5)) == 0  # every log point is at a change
    np.testing.assert_array_equal(phases(RETURNS, STEPS, 1_000)[0], RETURNS)


def test_dynamic_regret_is_the_optimum_less_all_rewards():
    """A bandit without noise, whose return is that of one step: 1 less it is what each step has lost."""
    agent = galton.make_agent(loss="gaussian", n_steps=5, n_envs=2, net_arch=())
    result = galton.train(DriftingBandit(noise_std=0.0, period=30), agent, [0, 1], 400, n_logs=8, n_eval_episodes=0)
    steps = result.steps // 2
    found = dynamic_regret(np.asarray(result.log.scalars["env_regret"]), steps)
    lost = (1 - np.asarray(result.log.training_return)) * np.asarray(result.log.n_episodes) / 2
    np.testing.assert_allclose(found, np.cumsum(lost, 1), rtol=1e-5)
    assert steps[-1] == 200
