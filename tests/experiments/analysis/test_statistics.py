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
from galton_experiments.analysis.statistics import (
    Interval,
    against,
    compare,
    difference_interval,
    fill_forward,
    fill_start,
    holm,
    least_p,
    mean_interval,
    performance_profile,
    stratified_bootstrap,
    within,
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


def samples(n, m, shift):
    rng = np.random.default_rng(n + m)
    return rng.normal(shift, 1, n), rng.normal(0, 3, m)


def test_independent_samples_are_compared_by_welch_and_by_mann_and_whitney():
    a, b = samples(12, 9, 1.0)
    found = compare(a, b)
    assert found.difference == difference_interval(a, b)
    assert found.p == pytest.approx(stats.mannwhitneyu(a, b, method="exact").pvalue)
    assert found.above == pytest.approx(np.mean([x > y for x in a for y in b]))
    assert compare(np.array([1.0, 2.0]), np.array([1.0, 0.0])).above == 3.5 / 4  # a tie counts half
    np.testing.assert_allclose(np.hstack(-found), np.hstack(compare(b, a)))


def test_pairs_are_compared_by_their_differences():
    a, noise = samples(12, 12, 5.0)
    b = a + 0.1 + 0.01 * noise
    found = compare(a, b, paired=True)
    scipys = stats.ttest_rel(a, b).confidence_interval(0.95)
    np.testing.assert_allclose(found.difference[1:], scipys)
    scipys = stats.permutation_test((a, b), share_above, permutation_type="samples", n_resamples=2**12)
    assert found.p == pytest.approx(scipys.pvalue)
    assert found.p < 0.01 < 0.5 < compare(a, b).p


def share_above(a, b):
    return np.mean(a[:, None] > b)


def test_a_difference_has_the_direction_of_mean_and_ranks_or_none():
    """Of runs that are all higher one that fails turns the mean, and not the ranks."""
    b = 10.0 * np.arange(1, 13)
    a = np.where(b < 120, b + 101, -1e4)
    found = compare(a, b, paired=True)
    assert found.p < 0.05
    assert found.difference.mean < 0
    assert found.above > 0.5
    assert found.direction == (-found).direction == 0
    assert compare(b + 1, b, paired=True).direction == 1
    assert compare(b, b + 1, paired=True).direction == -1
    assert compare(b, b, paired=True).direction == 0


@pytest.mark.parametrize(("n", "paired"), [(3, True), (7, True), (8, True), (8, False), (20, True)])
def test_the_least_p_is_that_of_runs_that_do_not_overlap(n, paired):
    a = np.arange(n) + 100.0
    least = least_p(n, n, paired)
    p = compare(a, a - 200, paired).p
    assert np.isnan(p) if least >= 0.05 else p == pytest.approx(least)


def test_seven_pairs_are_too_few_to_be_exchanged():
    a, b = samples(7, 7, 1.0)
    assert compare(a, b, paired=True).p == compare(a, b).p
    assert compare(a, b, paired=True).difference != compare(a, b).difference


@pytest.mark.parametrize(
    ("n", "m", "decides"), [(3, 3, False), (4, 4, True), (2, 6, False), (0, 9, False), (3, 5, True)]
)
def test_too_few_runs_have_no_p(n, m, decides):
    a, b = samples(n, m, 100.0)
    assert np.isnan(compare(a, b).p) != decides
    assert np.isnan(within(a, b, 200.0).p) != decides


def test_diverged_runs_are_left_out_of_a_comparison_and_out_of_pairs():
    a, b = samples(9, 9, 1.0)
    with_nan, other = np.append(a, NAN), np.append(b, 3.0)
    assert compare(with_nan, b) == compare(a, b)
    assert compare(with_nan, other, paired=True) == compare(a, b, paired=True)
    assert against(with_nan, 1.0) == against(a, 1.0)


def test_a_sample_is_compared_with_a_number_by_student():
    a, _ = samples(9, 9, 1.0)
    found, scipys = against(a, 0.5), stats.ttest_1samp(a, 0.5)
    assert found.p == pytest.approx(scipys.pvalue)
    np.testing.assert_allclose(np.array(found.difference[1:]) + 0.5, scipys.confidence_interval(0.95))
    assert found.above == (a > 0.5).mean()
    assert against(np.full(4, 2.0), 2.0).p == 1
    assert against(np.full(4, 2.0), 1.0).p == 0
    assert np.isnan(against(a[:2]).p)


def test_alike_is_a_difference_whose_interval_is_inside_the_margin():
    a, b = samples(20, 20, 0.3)
    mean, low, high = compare(a, b).difference
    inside = within(a, b, 4.0)
    assert inside.above == 1
    assert inside.p == pytest.approx(stats.ttest_ind(a - 4 * np.sign(mean), b, equal_var=False).pvalue)
    np.testing.assert_allclose(inside.difference.mean, 4 - abs(mean))
    np.testing.assert_allclose(inside.difference.low, 4 - max(abs(low), abs(high)))
    apart = within(np.array([-0.3, 0.0, 0.5, 1.7]), np.array([4.2, 3.2, 4.5, 5.1]), 10.0)
    assert apart.difference.high < 8, "that there is no difference is not in the interval"
    outside = within(a + 10, b, 4.0)
    assert outside.above == 0
    assert outside.p < 0.001
    assert outside.difference.high < 0
    assert within(a + 4, b, 4.0).p > 0.5


def test_holms_adjustment_worked_out_by_hand():
    """Sorted .005, .01, .03, .04 times 4, 3, 2, 1 are .02, .03, .06, .04, and none may be below one before it."""
    np.testing.assert_allclose(holm([0.01, 0.04, NAN, 0.03, 0.005]), [0.03, 0.06, NAN, 0.06, 0.02])
    np.testing.assert_allclose(holm([0.5, 0.9]), [1.0, 1.0])
    assert holm([]).size == 0


def test_holm_rarely_rejects_anything_true():
    p = np.random.default_rng(3).uniform(size=(2000, 6))
    assert np.mean([(holm(row.tolist()) < 0.05).any() for row in p]) == pytest.approx(0.05, abs=0.015)


def test_intervals_read_as_mean_and_half_width_or_as_both_ends():
    assert f"{mean_interval(np.array([-1.0, -3.0])):.1f}" == "−2.0 ± 12.7"
    assert f"{Interval(np.float64(1), np.float64(0.05), np.float64(2.05)):+.1f}" == "+1.0 ± 1.0"
    assert f"{Interval(np.float64(1), np.float64(-0.5), np.float64(1.5)):+.1f}" == "+1.0 [−0.5, +1.5]"
    assert f"{Interval(*np.full(3, -np.inf)):.1f}" == "−inf"


@settings(max_examples=50)
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
        (lambda: compare(X[:, 0], X[:3, 1], paired=True), "a has 10 runs and b 3; pairs need as many"),
        (lambda: stratified_bootstrap(X, interquartile_mean, 0), "n_resamples is 0; it must be"),
        (lambda: stratified_bootstrap(X, interquartile_mean, seed=-1), "seed is -1; it must be"),
    ],
)
def test_errors_name_the_argument_its_value_and_the_remedy(call, message):
    with pytest.raises(UsageError, match=message):
        call()


def test_fill_start_carries_the_first_known_value_back_and_nothing_else():
    nan = np.nan
    curves = np.array([[nan, nan, 1, nan, 2], [3, nan, nan, 4, nan], [nan, nan, nan, nan, nan]])
    np.testing.assert_array_equal(
        fill_start(curves), [[1, 1, 1, nan, 2], [3, nan, nan, 4, nan], [nan, nan, nan, nan, nan]]
    )


def test_fill_forward_carries_the_last_known_value():
    nan = np.nan
    curves = np.array([[nan, 1, nan, nan, 2, nan], [3, nan, nan, 4, nan, nan]])
    np.testing.assert_array_equal(fill_forward(curves), [[nan, 1, 1, 1, 2, 2], [3, 3, 3, 4, 4, 4]])
