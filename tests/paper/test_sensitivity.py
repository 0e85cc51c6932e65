import numpy as np
import pytest
from scipy import stats

from galton.analysis.statistics import mean_interval
from galton.paper.measures import spread
from galton.paper.scale import Scale
from galton.paper.sensitivity import marginals, stratified_mean
from galton.paper.summary import Summary

from . import made_up


def test_one_stratum_is_a_plain_mean():
    sample = np.random.default_rng(0).normal(size=(9, 4))
    ours, plain = stratified_mean([sample]), mean_interval(sample)
    np.testing.assert_allclose(ours, plain)


def test_strata_of_equal_size_are_a_stratified_sample():
    rng = np.random.default_rng(1)
    strata = [rng.normal(mean, 2, 8) for mean in (0, 10, -30)]
    interval = stratified_mean(strata)
    error = np.sqrt(sum(stats.sem(stratum) ** 2 for stratum in strata)) / 3
    assert interval.mean == pytest.approx(np.mean(strata))
    assert interval.high - interval.mean == pytest.approx(stats.t.ppf(0.975, 21) * error)


def test_the_interval_covers_the_strata_s_own_mean_19_times_in_20():
    rng = np.random.default_rng(2)
    centers = rng.normal(0, 50, 5)
    hits = []
    for _ in range(600):
        interval = stratified_mean([rng.normal(center, 3, 6) for center in centers])
        hits.append(interval.low < centers.mean() < interval.high)
    assert np.mean(hits) == pytest.approx(0.95, abs=0.03)


def test_a_marginal_holds_one_field_and_averages_the_rest():
    data = made_up.data(lambda _, setting: setting.hypers.eta + 100 * setting.hypers.learning_rate, ("lqr",))
    summary = data.sweeps["lqr"]
    rates = np.mean([setting.hypers.learning_rate for setting in summary.study.settings])
    found = marginals(summary, "hl-gauss", "eta", "training_return")
    assert list(found) == [0.25, 0.75]
    for eta, interval in found.items():
        assert interval.mean[-1] == pytest.approx(eta + 100 * rates, abs=0.02)
        assert interval.low[-1] < interval.mean[-1] < interval.high[-1]


WAY = Scale(-1.0, 9.0)


def test_a_spread_is_the_range_of_marginal_means_of_the_way_from_rest_to_the_best():
    data = made_up.data(lambda _, setting: setting.hypers.eta, ("lqr",), trials=6)
    summary = data.sweeps["lqr"]
    eta, rate = (spread(summary, "hl-gauss", field, WAY) for field in ("eta", "learning_rate"))
    assert eta.shape == (6,)
    np.testing.assert_allclose(eta, 0.5 / 10, atol=0.005)
    np.testing.assert_allclose(rate, 0, atol=0.005)
    assert spread(summary, "hl-gauss", "n_bins", WAY) is None


def test_noise_alone_is_no_spread():
    """The range of means that differ by noise is positive; halves that choose for one another cancel it."""
    study = made_up.data(lambda *_: 1.0, ("lqr",), budget="paper").sweeps["lqr"].study
    spreads = []
    for seed in range(40):
        table = made_up.results(study, lambda _: 1.0, noise=0.5, seed=seed)
        summary = Summary.of_results(study, table, made_up.PROVENANCE)
        spreads.append(spread(summary, "hl-gauss", "learning_rate", WAY).mean())
    assert abs(np.mean(spreads)) < 3 * stats.sem(spreads)
