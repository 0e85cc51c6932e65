import numpy as np
import pytest
from scipy import stats

from galton import UsageError
from galton_experiments.analysis.statistics import (
    Interval,
    against,
    compare,
    difference_interval,
    fill_start,
    fill_until,
    holm,
    least_p,
    mean_interval,
    within,
)

NAN = np.nan


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


def test_a_tie_is_written_alike_whatever_the_order_in_which_a_processor_added():
    means = np.float64(0.1 + 0.2 + 0.3) / 16, np.float64(0.3 + 0.2 + 0.1) / 16
    assert f"{means[0]:.3f}" != f"{means[1]:.3f}"
    assert {f"{Interval(mean, mean, mean):.3f}" for mean in means} == {"0.037 ± 0.000"}


def test_pairs_of_unequal_numbers_are_refused():
    with pytest.raises(UsageError, match="a has 10 runs and b 3; pairs need as many"):
        compare(np.zeros(10), np.zeros(3), paired=True)


def test_fill_start_carries_the_first_known_value_back_and_nothing_else():
    nan = np.nan
    curves = np.array([[nan, nan, 1, nan, 2], [3, nan, nan, 4, nan], [nan, nan, nan, nan, nan]])
    np.testing.assert_array_equal(
        fill_start(curves), [[1, 1, 1, nan, 2], [3, nan, nan, 4, nan], [nan, nan, nan, nan, nan]]
    )


def test_fill_until_carries_the_last_known_value():
    nan = np.nan
    curves = np.array([[nan, 1, nan, nan, 2, nan], [3, nan, nan, 4, nan, nan]])
    filled = fill_until(curves, np.arange(6), np.array([-1, 4]))
    np.testing.assert_array_equal(filled, [[nan, 1, 1, 1, 2, 2], [3, 3, 3, 4, nan, nan]])
