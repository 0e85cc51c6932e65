import numpy as np
import pytest
from scipy import stats

from galton_experiments.analysis.bands import mean_band


def test_one_stratum_has_scipys_percentiles():
    sample = np.random.default_rng(0).exponential(size=30)
    band = mean_band([sample], n_resamples=20_000)
    theirs = stats.bootstrap((sample,), np.mean, n_resamples=20_000, method="percentile", rng=1).confidence_interval
    assert band.mean == pytest.approx(sample.mean())
    assert (band.low, band.high) == pytest.approx((theirs.low, theirs.high), abs=0.01)


def test_strata_of_unequal_size_are_a_stratified_sample():
    rng = np.random.default_rng(1)
    strata = [rng.normal(mean, 2, n) for mean, n in ((0, 40), (10, 60), (-30, 50))]
    band = mean_band(strata, n_resamples=20_000)
    error = np.sqrt(sum(stratum.var() / len(stratum) for stratum in strata)) / 3
    assert band.mean == pytest.approx(np.mean([stratum.mean() for stratum in strata]))
    assert (band.low, band.high) == pytest.approx((band.mean - 1.96 * error, band.mean + 1.96 * error), abs=0.02)


def test_the_band_covers_the_strata_s_own_mean_19_times_in_20():
    rng = np.random.default_rng(2)
    centers = rng.normal(0, 50, 5)
    hits = []
    for _ in range(600):
        band = mean_band([rng.normal(center, 3, 20) for center in centers])
        hits.append(band.low < centers.mean() < band.high)
    assert np.mean(hits) == pytest.approx(0.95, abs=0.03)


def test_no_band_leaves_the_range_of_the_runs():
    runs = np.array([[-10.0, -9.8], [-9.8, -9.8], [-150.0, -9.8]])
    band = mean_band([runs])
    np.testing.assert_allclose(band.high, [-9.8, -9.8])
    np.testing.assert_allclose(band.low, [-150, -9.8])


def test_unknown_runs_are_left_out_and_one_alone_has_no_band():
    runs = np.array([[1.0, 1.0, 1.0], [3.0, np.nan, np.nan], [5.0, 5.0, np.nan]])
    band = mean_band([runs])
    np.testing.assert_allclose(band.mean, [3, 3, 1])
    assert np.isnan([band.low[2], band.high[2]]).all()
    assert (band.low[:2] < band.mean[:2]).all()
    two = mean_band([runs, runs + 10])
    np.testing.assert_allclose(two.mean, [8, 8, 6])


def test_the_same_runs_have_the_same_band():
    runs = np.random.default_rng(3).normal(size=(5, 7))
    np.testing.assert_array_equal(mean_band([runs]), mean_band([runs]))


@pytest.mark.parametrize("value", [1.0, -500.0, 0.1])
@pytest.mark.parametrize("n", range(2, 21))
def test_the_mean_of_equal_runs_lies_in_its_band(n, value):
    mean, low, high = mean_band([np.full(n, value)] * 3)
    assert low <= mean <= high
    assert high - low < 1e-12 * abs(value)
