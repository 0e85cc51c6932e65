"""Verdicts on grids whose outcome is chosen: sensitivity, robustness, and the share of high returns."""

import dataclasses

import numpy as np
import pytest

from galton_experiments.runs import Summary
from studies.paper import profiles
from studies.paper.claims import of_figure

from . import made_up
from .made_up import SWEEPS
from .test_claims import CLASSIFIED, judged


def sensitivities(data):
    """Judge what is claimed of Figures 4 to 6."""
    found = [judge(data) for name in ("figure-4", "figure-5", "figure-6") for judge in of_figure(name)]
    return {claim.words: claim for claim in found}


def test_sensitivity_is_read_off_the_marginals():
    by_rate = sensitivities(made_up.judgeable(lambda _, setting: 10_000 * setting["learning_rate"], ("lqr",)))
    assert by_rate["HL-Gauss is sensitive to the learning rate."].verdict == "holds"
    assert by_rate["HL-Gauss is sensitive to η."].verdict == "does not hold"
    assert by_rate["HL-Gauss is robust to the number of bins."].verdict == "not decidable here"
    also = "The Gaussian and HL-1-Hot are also sensitive to the learning rate, as HL-Gauss is."
    assert by_rate[also].verdict == "holds"
    calm = made_up.judgeable(lambda _, s: 10_000 * s["learning_rate"] * (s["loss"] == "hl-gauss"), ("lqr",))
    assert sensitivities(calm)[also].verdict == "does not hold"


def test_a_share_about_a_tenth_is_neither_sensitive_nor_robust():
    """The widest η of the paper's grid costs so much of the way from rest to the optimum, 16.26."""
    etas = sorted({s["eta"] for s in SWEEPS["lqr"].study("paper", {}).settings if s["loss"] == "hl-gauss"})

    def verdict_of(share):
        def final_of(_, setting):
            return 16 - 16.26 * share * (setting["loss"] == "hl-gauss" and setting["eta"] == etas[-1])

        data = made_up.judgeable(final_of, ("lqr",), budget="paper", noise=0.5)
        return sensitivities(data)["HL-Gauss is sensitive to η."].verdict

    assert verdict_of(0.2) == "holds"
    assert verdict_of(0.1) == "not decidable here"
    assert verdict_of(0.03) == "does not hold"


def test_bins_that_matter_as_much_for_both_losses():
    words = "HL-1-Hot is similarly robust to the number of bins as HL-Gauss."

    def verdict_of(share):
        """Judge with 200 bins that cost HL-1-Hot this share of the way from rest to the optimum."""

        def final_of(_, setting):
            return 16 - 16.26 * share * (setting["loss"] == "hl-one-hot" and setting["n_bins"] == 200)

        return sensitivities(made_up.judgeable(final_of, ("lqr",), budget="paper"))[words].verdict

    assert verdict_of(0.0) == verdict_of(0.05) == "holds"
    assert verdict_of(0.2) == "does not hold"


def test_robust_is_how_much_the_learning_rate_matters_not_how_high_runs_end():
    """A level below the Gaussian's is no spread; a spread is, wherever it lies."""

    def steep(losses, lower):
        def final_of(_, setting):
            ours = setting["loss"] in CLASSIFIED
            moved = 5000 * setting["learning_rate"] * (setting["loss"] in losses)
            return 10 - lower * ours - moved

        return made_up.judgeable(final_of, ("lqr",))

    low = profiles.robust_to_settings(steep(["gaussian"], lower=9))
    assert low.verdict == "holds"
    assert "LQR −0.50 ± 0.00" in low.why.split("Level")[1]
    assert profiles.robust_to_settings(steep(CLASSIFIED, lower=-9)).verdict == "does not hold"
    assert profiles.robust_to_settings(steep(["hl-gauss", "gaussian"], lower=0)).count == (1, 2)


def test_the_level_is_mann_and_whitneys_and_its_interval_covers_19_times_in_20():
    """P of a normal run, 0.5 higher than another, is 0.638; its settings differ by less than its trials do."""
    study = dataclasses.replace(SWEEPS["lqr"].study("smoke", {}), trials=15)
    hits = []
    for seed in range(200):
        table = made_up.results(study, lambda s: 0.5 * (s["loss"] in CLASSIFIED), noise=1.0, seed=seed)
        mean, low, high = profiles.level(Summary.of_results(study, table, made_up.PROVENANCE))
        hits.append(low < 0.138 < high)
        assert low < mean < high
    assert np.mean(hits) == pytest.approx(0.95, abs=0.04)


def test_a_higher_fraction_is_of_high_returns():
    """Most of the classification runs are better than the Gaussian's; but those that are good are the Gaussian's."""
    rates = sorted({setting["learning_rate"] for setting in SWEEPS["lqr"].study("smoke", {}).settings})

    def final_of(_, setting):
        return 1.0 if setting["loss"] in CLASSIFIED else 5.0 if setting["learning_rate"] == rates[-1] else 0.0

    assert judged(profiles.higher_fraction, final_of, names=("lqr",)) == "does not hold"
