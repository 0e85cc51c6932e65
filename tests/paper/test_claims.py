"""Verdicts on sweeps whose outcome is chosen."""

import dataclasses

import numpy as np
import pyarrow as pa
import pytest

from galton.analysis.statistics import Interval
from galton.paper import bandit, controls, profiles, returns, sensitivity
from galton.paper.measures import better, by_setting, final_return, over_regression
from galton.paper.registry import FIGURES
from galton.paper.report import claims
from galton.paper.summary import Summary
from galton.paper.trained import Trained
from galton.paper.verdicts import decided, verdict

from . import made_up
from .made_up import SWEEPS

PROPOSITIONS = "§4.3, Propositions 1 and 2"
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
        return winning("hl-gauss" if name.startswith(("lqr", "reacher")) else "gaussian")(name, setting)

    tasks = [f"{task}{part}" for task in ("lqr", "reacher", "ant", "bandit") for part in ("", "-again")]
    assert judged(claim, mixed, names=tasks) == "holds in part"
    assert judged(claim, mixed) == "does not hold"
    why = claim(made_up.data(mixed)).why
    assert why.startswith("As the paper says: LQR, Reacher; the other way round: Bandit, Mountain Car, HalfCheetah")


def test_the_better_loss_is_chosen_by_other_runs_than_it_is_judged_by():
    """On the grid HL-1-Hot is better; on fresh seeds HL-Gauss is, and alone beats the Gaussian."""

    def lucky(name, setting):
        return 3.0 if setting.config.loss == ("hl-gauss" if name.endswith("-again") else "hl-one-hot") else 1.0

    task = judged_task(lucky)
    assert better(task.chosen, final_return) == "hl-one-hot"
    assert abs(over_regression(task).mean) < 0.1


def judged_task(final_of):
    return made_up.data(final_of, ("lqr", "lqr-again")).judged["lqr"]


def with_finals(data, name, metric, losses, change):
    """The data with other final numbers of some losses in one sweep."""
    summary = data.sweeps[name]
    rows = summary.rows(*(setting for setting in summary.study.settings if setting.config.loss in losses))
    finals = summary.final(metric)
    finals[rows] = change(finals[rows])
    column = summary.table.column_names.index(f"final_{metric}")
    table = summary.table.set_column(column, f"final_{metric}", pa.array(finals.astype(np.float32)))
    return dataclasses.replace(data, sweeps=data.sweeps | {name: dataclasses.replace(summary, table=table)})


def test_without_fresh_seeds_nothing_is_judged():
    data = made_up.data(winning("hl-gauss"), ("lqr", "mountain-car"))
    for claim in (returns.ends_higher, returns.learns_faster, returns.more_stable, returns.order_changes):
        assert claim(data).verdict == "not decidable here"


def test_where_the_softmax_loses_its_entropy_is_told_and_where_nobody_gains_that():
    data = made_up.data(lambda _, s: -5.0 if s.config.loss in CLASSIFIED else -1.0)
    why = returns.ends_higher(data).why
    assert ", LQR -5.0 of 6.0 nats" in why  # all that is logged is made up alike; 2 log 20
    assert "Not clearly above what doing nothing earns: Mountain Car (Gaussian, HL-1-Hot, HL-Gauss), Half" in why


def test_without_the_noise_of_exploration_the_order_may_be_another():
    data = made_up.data(winning("hl-gauss"), ("lqr", "lqr-again"))
    quiet = with_finals(data, "lqr-again", "evaluation_return", ["gaussian"], lambda finals: finals + 100)
    claim = returns.ends_higher(quiet)
    assert claim.verdict == "holds"
    assert "By the deterministic policy's return (Figure 8), the other way round: LQR." in claim.why


def test_centred_hl_gauss_counts_for_nothing_in_the_papers_claims():
    assert judged(returns.ends_higher, winning("hl-gauss-centred")) == "not decidable here"


@pytest.mark.parametrize(("wild", "expected"), [(["gaussian"], "holds"), (CLASSIFIED, "does not hold")])
def test_calm_is_how_near_seeds_end_to_one_another(wild, expected):
    data = made_up.data(lambda *_: 1.0, ("lqr", "lqr-again"), budget="paper")
    louder = with_finals(data, "lqr-again", "training_return", wild, lambda finals: 1 + 100 * (finals - 1))
    assert returns.more_stable(louder).verdict == expected


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
        (controls.starts_as_well, "bandit-init-gaussian-again", {-1: "does not hold", 0: "holds", 1: "holds"}),
        (controls.converges_faster, "bandit-gaussian-exploration-again", {-1: "does not hold", 1: "holds"}),
        (controls.no_local_optimum, "bandit-gaussian-exploration-again", {-1: "does not hold", 1: "holds in part"}),
    ],
)
def test_the_two_controls(claim, control, wanted):
    for gain, expected in wanted.items():
        assert judged(claim, lambda name, _, gain=gain: 1.0 + gain * (name == control)) == expected


def sensitivities(data):
    """What is claimed of Figures 4 to 6."""
    return [judge(data) for name in ("figure-4", "figure-5", "figure-6") for judge in FIGURES[name].claims.values()]


def test_sensitivity_is_read_off_the_marginals():
    by_rate = made_up.data(lambda _, setting: 1000 * setting.hypers.learning_rate)
    verdicts = {claim.words: claim.verdict for claim in sensitivities(by_rate)}
    assert verdicts["HL-Gauss is sensitive to the learning rate."] == "holds"
    assert verdicts["HL-Gauss is sensitive to η."] == "does not hold"
    assert verdicts["HL-Gauss is robust to the number of bins."] == "not decidable here"


def test_a_share_about_a_tenth_is_neither_sensitive_nor_robust():
    """From −1 to 1 at the narrowest η, the widest of the paper's grid costs so much of it."""
    etas = sorted({s.hypers.eta for s in SWEEPS["lqr"].study("paper", {}).settings if s.config.loss == "hl-gauss"})

    def verdict_of(share):
        def final_of(_, setting):
            return 1 - 2 * share * (setting.config.loss == "hl-gauss" and setting.hypers.eta == etas[-1])

        data = made_up.data(final_of, ("lqr",), budget="paper", noise=0.1)
        return {claim.words: claim.verdict for claim in sensitivities(data)}["HL-Gauss is sensitive to η."]

    assert verdict_of(0.2) == "holds"
    assert verdict_of(0.1) == "not decidable here"
    assert verdict_of(0.03) == "does not hold"


def test_wide_targets():
    assert judged(sensitivity.wide_targets, lambda _, s: -s.hypers.eta) == "holds"
    assert judged(sensitivity.wide_targets, lambda _, s: s.hypers.eta) == "does not hold"


@pytest.mark.parametrize("claim", [profiles.robust_to_settings, profiles.higher_fraction])
def test_fractions(claim):
    assert judged(claim, winning("gaussian")) == "does not hold"
    assert judged(claim, lambda _, s: 5.0 if s.config.loss in CLASSIFIED else 1.0) == "holds"


def test_a_higher_fraction_is_of_high_returns():
    """Most of the classification runs are better than the Gaussian's; but those that are good are the Gaussian's."""
    rates = sorted({setting.hypers.learning_rate for setting in SWEEPS["lqr"].study("smoke", {}).settings})

    def final_of(_, setting):
        return 1.0 if setting.config.loss in CLASSIFIED else 5.0 if setting.hypers.learning_rate == rates[-1] else 0.0

    assert judged(profiles.higher_fraction, final_of, names=("lqr",)) == "does not hold"
    assert judged(profiles.robust_to_settings, final_of, names=("lqr",)) == "not decidable here"


def test_orders():
    def ahead(name, setting):
        return winning("hl-gauss" if name.startswith("lqr") else "hl-one-hot")(name, setting)

    def a_little(name, setting):
        return 0.02 * ahead(name, setting)

    assert judged(returns.order_changes, winning("hl-gauss")) == "does not hold"
    assert judged(returns.order_changes, ahead) == "holds in part"
    assert judged(returns.order_changes, lambda *_: 1.0) == "holds in part"
    assert judged(returns.order_changes, a_little, noise=1e-4) == "holds"
    assert "which is HL-1-Hot" not in returns.order_changes(made_up.data(ahead)).why
    narrow = made_up.data(lambda _, s: -s.hypers.eta, ("lqr", "lqr-again"), budget="paper")
    assert "On LQR the best η is at most 0.1, which is HL-1-Hot." in returns.order_changes(narrow).why


def test_a_run_that_diverged_counts_as_the_worst():
    study = SWEEPS["lqr"].study("smoke", {})
    table = made_up.results(study, lambda _: 1.0, diverged=[0, 1])
    summary = Summary.of_results(study, table, made_up.PROVENANCE)
    assert study.settings[0].config.loss == "gaussian"
    first = by_setting(summary, "gaussian")[0]
    np.testing.assert_array_equal(first, np.nanmin(summary.curves("training_return")))


def test_a_small_grid_has_no_vote_beside_the_papers():
    data = made_up.data(lambda *_: 1.0, ("lqr", "acrobot"))
    lqr = dataclasses.replace(data.sweeps["lqr"], provenance=made_up.PROVENANCE | {"budget": "paper"})
    assert [*data.largest_grids] == ["lqr", "acrobot"]
    assert [*Trained(data.sweeps | {"lqr": lqr}).largest_grids] == ["lqr"]
    assert Trained({}).largest_grids == {}


def test_what_gives_no_gain_can_not_be_explained():
    def final_of(name, setting):
        gains = setting.config.loss == "hl-gauss"
        return 5.0 if gains and "exploration" not in name else 1.0

    bandits = made_up.data(final_of, BANDITS)
    claim = controls.exploration_is_not_the_reason(bandits)
    assert claim.verdict == "holds in part"
    assert claim.why.startswith("As the paper says: HL-Gauss with Init Gaussian; no clear difference: HL-Gauss with")
    assert "Not clearly more efficient to begin with: HL-1-Hot " in claim.why
    flat = controls.exploration_is_not_the_reason(made_up.data(lambda *_: 1.0, BANDITS))
    assert flat.verdict == "not decidable here"
    assert flat.why.startswith("Not clearly more efficient to begin with: HL-1-Hot ")


def test_what_is_removed_leaves_less_than_half():
    def with_it(gain):
        return lambda name, _: -20.0 + gain * (name == "bandit-gaussian-exploration-again")

    assert judged(controls.no_local_optimum, with_it(10.0), names=BANDITS) == "holds in part"
    assert judged(controls.no_local_optimum, with_it(44.0), names=BANDITS) == "holds"


def test_without_data_nothing_is_decided():
    found = claims(Trained({}))
    assert len(found) == 29
    assert {claim.verdict for claim in found} == {"not decidable here"}


def test_claims_stand_in_the_order_of_the_paper_and_rest_on_their_figures():
    assert sorted(place for figure in FIGURES.values() for place in figure.claims) == list(range(1, 30))
    found = claims(Trained({}))
    assert [claim.source for claim in found[:5]] == ["§1, §5.2.1", "Abstract, §5.2.1", "§5.2.1", "§1", PROPOSITIONS]
    assert [claim.section for claim in found[:5]] == ["figure-2", "figure-2", "figure-9", "figure-2", "propositions"]


def test_what_has_no_interval_is_not_decided():
    nan = Interval(1.0, np.nan, np.nan)
    assert decided({"one": nan, "two": Interval(1.0, 0.5, 1.5)}) == {"two": Interval(1.0, 0.5, 1.5)}
    assert verdict([nan]) == "not decidable here"


def test_a_verdict_needs_whole_intervals():
    assert verdict([Interval(1.0, 0.1, 2.0), Interval(1.0, -0.1, 2.0)]) == "holds in part"
    assert verdict([Interval(1.0, -0.1, 2.0)]) == "not decidable here"
    assert verdict([Interval(1.0, -0.1, 2.0), Interval(-1.0, -2.0, -0.1)]) == "does not hold"
    assert verdict([Interval(1.0, 0.1, 2.0), Interval(-1.0, -2.0, -0.1)]) == "holds in part"
    assert verdict([Interval(1.0, 0.1, 2.0), *[Interval(-1.0, -2.0, -0.1)] * 2]) == "does not hold"
    assert verdict([Interval(1.0, np.nan, np.nan), Interval(1.0, 0.1, 2.0)]) == "holds"
    assert verdict([]) == "not decidable here"
