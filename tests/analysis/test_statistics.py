import numpy as np
import pytest
from scipy import stats

from galton.analysis.statistics import difference_interval, fill_forward, mean_interval


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


def test_intervals_read_as_mean_and_half_width():
    assert f"{mean_interval(np.array([-1.0, -3.0])):.1f}" == "−2.0 ± 12.7"


def test_fill_forward_carries_the_last_known_value():
    nan = np.nan
    curves = np.array([[nan, 1, nan, nan, 2, nan], [3, nan, nan, 4, nan, nan]])
    np.testing.assert_array_equal(fill_forward(curves), [[nan, 1, 1, 1, 2, 2], [3, 3, 3, 4, 4, 4]])
