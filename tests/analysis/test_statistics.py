import importlib
import importlib.util
import sys

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from rliable import metrics
from scipy import stats

from galton import UsageError
from galton.analysis.statistics import (
    Interval,
    difference_interval,
    fill_forward,
    mean_interval,
    performance_profile,
    stratified_bootstrap,
)

NAN = np.nan
TAUS = np.linspace(-2, 4, 5)


def of_three_tasks(n_runs, shift=0.0):
    return np.random.default_rng(n_runs).normal((shift, 1 + shift, 2 + shift), 1.0, (n_runs, 3))


X = of_three_tasks(10, 0.3)


def interquartile_mean(tasks):
    """The mean of the middle half of all scores; a diverged run counts as −∞."""
    pooled = np.concatenate([*tasks.T] if isinstance(tasks, np.ndarray) else tasks)
    return float(stats.trim_mean(np.where(np.isnan(pooled), -np.inf, pooled), 0.25))


def scores(n_runs):
    """Few values, so that there are ties, and some diverged runs."""
    return arrays(float, (n_runs, 3), elements=st.sampled_from([-1.5, 0.0, 1.0, 2.5, NAN]))


@pytest.fixture(scope="module")
def rliable():
    # It bootstraps with arch, of which only the bootstrap imports with pandas 3: leave the package's own module empty.
    sys.modules["arch"] = importlib.util.module_from_spec(importlib.util.find_spec("arch"))
    return importlib.import_module("rliable.library")


def test_mean_interval_is_scipys():
    samples = np.random.default_rng(0).normal(3, 2, (12, 5))
    interval = mean_interval(samples)
    scipys = stats.ttest_1samp(samples, 0).confidence_interval(0.95)
    np.testing.assert_allclose(interval.mean, samples.mean(0))
    np.testing.assert_allclose((interval.low, interval.high), scipys, rtol=1e-10)


def test_nan_samples_are_left_out():
    samples = np.array([1.0, 2.0, np.nan, 4.0])
    assert mean_interval(samples) == mean_interval(samples[~np.isnan(samples)])
    assert np.isnan(mean_interval(np.array([np.nan, np.nan])).mean)


def test_one_sample_has_a_mean_and_no_interval():
    interval = mean_interval(np.array([5.0]))
    assert interval.mean == 5
    assert np.isnan(interval.low)
    assert f"{interval:.1f}" == "5.0"


def test_the_interval_covers_the_mean_19_times_in_20():
    samples = np.random.default_rng(1).normal(1.0, 3.0, (8, 4000))
    interval = mean_interval(samples)
    assert ((interval.low < 1) & (interval.high > 1)).mean() == pytest.approx(0.95, abs=0.012)


def test_difference_interval_is_welchs():
    rng = np.random.default_rng(2)
    a, b = rng.normal(1, 1, 9), rng.normal(0, 4, 15)
    scipys = stats.ttest_ind(a, b, equal_var=False).confidence_interval(0.95)
    np.testing.assert_allclose(difference_interval(a, b)[1:], scipys, rtol=1e-10)
    assert difference_interval(np.ones(3), np.zeros(3)) == (1, 1, 1)
    assert np.isnan(difference_interval(np.ones(1), b).low)


def test_intervals_read_as_mean_and_half_width_or_as_both_ends():
    assert f"{mean_interval(np.array([-1.0, -3.0])):.1f}" == "−2.0 ± 12.7"
    assert f"{Interval(np.float64(1), np.float64(0.05), np.float64(2.05)):+.1f}" == "+1.0 ± 1.0"
    assert f"{Interval(np.float64(1), np.float64(-0.5), np.float64(1.5)):+.1f}" == "+1.0 [−0.5, +1.5]"
    assert f"{Interval(*np.full(3, -np.inf)):.1f}" == "−inf"


@settings(deadline=None, max_examples=50)
@given(x=scores(7))
def test_a_profile_is_the_share_above_with_diverged_runs_below_every_score(x):
    low_x = np.nan_to_num(x, nan=-9.0)
    profile = performance_profile(x, TAUS, n_resamples=1).mean
    np.testing.assert_allclose(profile, [(low_x > tau).mean() for tau in TAUS], atol=1e-12)


# rliable's bootstrap varies too: over 20 seeds its bounds have a standard deviation of at most 0.013 (interquartile
# mean, 2000 resamples), and the profile's jump by one run in 30. A tolerance is 4√2 of them. Resampling across tasks
# would move the first's bounds by 0.11.
def test_interval_of_the_interquartile_mean_is_rliables(rliable):
    np.random.seed(0)  # noqa: NPY002 — rliable draws from NumPy's global generator
    estimate, bounds = rliable.get_interval_estimates({0: X}, lambda x: np.array([metrics.aggregate_iqm(x)]), reps=2000)
    interval = stratified_bootstrap(X, interquartile_mean)
    assert interval.mean == pytest.approx(estimate[0][0], abs=1e-12)
    np.testing.assert_allclose(interval[1:], bounds[0][:, 0], atol=0.07)


def test_band_of_the_performance_profile_is_rliables(rliable):
    np.random.seed(0)  # noqa: NPY002 — as above
    profile, band = rliable.create_performance_profile({0: X}, TAUS)
    interval = performance_profile(X, TAUS)
    np.testing.assert_allclose(interval.mean, profile[0], atol=1e-12)
    np.testing.assert_allclose(interval[1:], band[0], atol=1.01 / 30)


def test_runs_are_resampled_within_their_task():
    tasks = [np.zeros(3), np.full(5, 10.0)]
    assert stratified_bootstrap(tasks, lambda tasks: np.mean([task.mean() for task in tasks])) == (5, 5, 5)
    assert stratified_bootstrap(X, interquartile_mean, 50) == stratified_bootstrap(list(X.T), interquartile_mean, 50)


def test_each_task_weighs_the_same_however_many_runs_it_has():
    x = [np.array([1.0]), np.array([0.0, 0.0, 0.0])]
    np.testing.assert_array_equal(performance_profile(x, np.array([-1.0, 0.0, 1.0])).mean, [1, 0.5, 0])


def test_more_than_a_quarter_of_diverged_runs_is_worse_than_any_score():
    tasks = [np.array([NAN, NAN, 3.0, 4.0, 5.0, 6.0, 7.0, 8.0])]
    interval = stratified_bootstrap(tasks, interquartile_mean, 500)
    assert interval.mean == 4.5
    assert interval.low == -np.inf
    assert np.isfinite(interval.high)
    assert np.isnan(stratified_bootstrap(tasks, lambda tasks: tasks[0].mean(), 500).low)


def test_one_run_of_a_task_has_no_interval():
    interval = performance_profile([X[:, 0], X[:1, 1]], TAUS)
    assert np.isfinite(interval.mean).all()
    assert np.isnan(interval[1:]).all()


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda: performance_profile([], TAUS), "scores has no tasks; give"),
        (lambda: performance_profile([X[:, 0], X[:0, 1]], TAUS), r"scores\[1\] has shape \(0,\); give"),
        (lambda: stratified_bootstrap(X, interquartile_mean, 0), "n_resamples is 0; it must be"),
        (lambda: stratified_bootstrap(X, interquartile_mean, seed=-1), "seed is -1; it must be"),
    ],
)
def test_errors_name_the_argument_its_value_and_the_remedy(call, message):
    with pytest.raises(UsageError, match=message):
        call()


def test_fill_forward_carries_the_last_known_value():
    nan = np.nan
    curves = np.array([[nan, 1, nan, nan, 2, nan], [3, nan, nan, 4, nan, nan]])
    np.testing.assert_array_equal(fill_forward(curves), [[nan, 1, 1, 1, 2, 2], [3, 3, 3, 4, 4, 4]])
