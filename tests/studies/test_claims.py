"""Verdicts on sweeps whose outcome is chosen."""

import numpy as np
import pytest

from galton.analysis.statistics import Interval
from galton.studies.base import Data
from galton.studies.claims import all_claims, bandit, returns, settings
from galton.studies.claims.verdicts import decided, verdict
from galton.studies.sweeps import SWEEPS

from . import made_up

CLASSIFIED = ("hl-one-hot", "hl-gauss", "hl-gauss-centred")


BANDITS = tuple(name for name in SWEEPS if name.startswith("bandit"))


def judged(claim, final_of, **options):
    return claim(made_up.data(final_of, **options)).verdict


def winning(loss):
    return lambda _, setting: 5.0 if setting.config.loss == loss else 1.0


@pytest.mark.parametrize("claim", [returns.ends_higher, returns.learns_faster])
def test_classification_wins_loses_or_wins_somewhere(claim):
    assert judged(claim, winning("hl-one-hot")) == "holds"
    assert judged(claim, winning("gaussian")) == "does not hold"

    def mixed(name, setting):
        return winning("hl-gauss" if name.startswith("lqr") else "gaussian")(name, setting)

    assert judged(claim, mixed) == "holds in part"
    assert "better: LQR; worse: Bandit" in claim(made_up.data(mixed)).why


def test_centred_hl_gauss_counts_for_nothing_in_the_papers_claims():
    assert judged(returns.ends_higher, winning("hl-gauss-centred")) == "not decidable here"


def test_calm_is_a_spread_between_seeds():
    wide, narrow = np.array([-8.0, 0.0, 8.0]), np.array([-1.0, 0.0, 1.0])
    assert returns._calm([wide, narrow]) == 3
    assert returns.more_stable(made_up.data(winning("hl-gauss"))).number.startswith("Bandit ")


def test_acrobot_is_judged_the_other_way_round():
    assert judged(returns.acrobot, winning("gaussian")) == "holds"
    assert judged(returns.acrobot, winning("hl-gauss")) == "does not hold"


def noisy(hurt):
    return lambda name, setting: -9.0 if name == "bandit-noise-10" and setting.config.loss in hurt else 1.0


def test_noise_that_hurts_one_side():
    assert judged(bandit.less_sensitive_to_noise, noisy(["gaussian"])) == "holds"
    assert judged(bandit.less_sensitive_to_noise, noisy(CLASSIFIED)) == "does not hold"
    mixed = noisy(["gaussian", "hl-gauss"])
    assert judged(bandit.less_sensitive_to_noise, mixed, names=BANDITS, budget="small") == "holds in part"


def test_dimensions():
    def harder(name, setting):
        return (3.0 if setting.config.loss != "gaussian" else 1.0) - (name == "bandit-d-16")

    def easier(name, setting):
        return 1.0 + (name == "bandit-d-16")

    assert judged(bandit.degrades_with_dimension, harder) == "holds"
    assert judged(bandit.degrades_with_dimension, easier) == "does not hold"
    assert judged(bandit.higher_in_all_dimensions, harder) == "holds"
    assert judged(bandit.higher_in_all_dimensions, winning("gaussian")) == "does not hold"


@pytest.mark.parametrize(
    ("claim", "control", "wanted"),
    [
        (bandit.init_gaussian, "bandit-init-gaussian", {-1: "does not hold", 0: "holds", 1: "holds"}),
        (bandit.gaussian_exploration, "bandit-gaussian-exploration", {-1: "does not hold", 1: "holds"}),
        (bandit.no_local_optimum, "bandit-gaussian-exploration", {-1: "does not hold", 1: "holds"}),
    ],
)
def test_the_two_controls(claim, control, wanted):
    for gain, expected in wanted.items():
        assert judged(claim, lambda name, _, gain=gain: 1.0 + gain * (name == control)) == expected


def test_sensitivity_is_read_off_the_marginals():
    by_rate = made_up.data(lambda _, setting: 1000 * setting.hypers.learning_rate)
    verdicts = {claim.words: claim.verdict for claim in settings.sensitivities(by_rate)}
    assert verdicts["HL-Gauss is sensitive to the learning rate."] == "holds"
    assert verdicts["HL-Gauss is sensitive to η."] == "does not hold"
    assert verdicts["HL-Gauss is robust to the number of bins."] == "not decidable here"


def test_fractions_and_orders():
    assert judged(settings.higher_fraction, winning("gaussian")) == "does not hold"
    assert judged(settings.higher_fraction, lambda _, s: 5.0 if s.config.loss in CLASSIFIED else 1.0) == "holds"
    assert judged(returns.order_changes, winning("hl-gauss")) == "holds in part"
    assert (
        judged(returns.order_changes, lambda name, s: winning("hl-gauss" if "lqr" in name else "hl-one-hot")(name, s))
        == "holds"
    )


def test_without_data_nothing_is_decided():
    found = all_claims(Data({}))
    assert len(found) >= 15
    assert {claim.verdict for claim in found} == {"not decidable here"}


def test_what_has_no_interval_is_not_decided():
    nan = Interval(1.0, np.nan, np.nan)
    assert decided({"one": nan, "two": Interval(1.0, 0.5, 1.5)}) == {"two": Interval(1.0, 0.5, 1.5)}
    assert verdict([nan]) == "not decidable here"


def test_a_verdict_needs_whole_intervals():
    assert verdict([Interval(1.0, 0.1, 2.0), Interval(1.0, -0.1, 2.0)]) == "holds in part"
    assert verdict([Interval(1.0, -0.1, 2.0)]) == "not decidable here"
    assert verdict([Interval(1.0, -0.1, 2.0), Interval(-1.0, -2.0, -0.1)]) == "does not hold"
    assert verdict([Interval(1.0, np.nan, np.nan), Interval(1.0, 0.1, 2.0)]) == "holds"
    assert verdict([]) == "not decidable here"
