import numpy as np
import pytest
from scipy import stats

from galton_experiments.runs import Summary
from studies.paper.measures import spread
from studies.paper.sensitivity import draw, marginals
from studies.paper.trained import Scale

from . import made_up


def test_a_marginal_holds_one_field_and_averages_the_rest():
    data = made_up.data(lambda _, setting: setting["eta"] + 100 * setting["learning_rate"], ("lqr",))
    summary = data.sweeps["lqr"]
    rates = np.mean([setting["learning_rate"] for setting in summary.study.settings])
    found = marginals(summary, "hl-gauss", "eta", "training_return")
    assert list(found) == [0.25, 0.75]
    for eta, interval in found.items():
        assert interval.mean[-1] == pytest.approx(eta + 100 * rates, abs=0.02)
        assert interval.low[-1] < interval.mean[-1] < interval.high[-1]


WAY = Scale(-1.0, 9.0)


def test_a_spread_is_the_range_of_marginal_means_of_the_way_from_rest_to_the_best():
    data = made_up.data(lambda _, setting: setting["eta"], ("lqr",), trials=6)
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


def test_a_row_per_field_and_a_column_per_task_with_words_where_there_is_one_value():
    data = made_up.data(lambda _, setting: setting["eta"], ("lqr", "ant"))
    figure = draw(data.grids, "hl-gauss", ("learning_rate", "n_bins", "eta"))
    rates, _, etas, missing = figure.axes  # k is nowhere varied
    assert [axes.get_ylabel() for axes in (rates, etas)] == [
        "by learning rate\ntraining return",
        "by η\ntraining return",
    ]
    assert missing.texts[0].get_text() == "η 0.25\nalone"
    assert rates.get_title() == "LQR\n2 trials × 0 of 72 settings"
    assert rates.texts[-1].get_text() == "learning rate 0.0003–0.0007 coincide"
    assert etas.texts[-1].get_text() == ""
    assert rates.get_ylim() == etas.get_ylim()
