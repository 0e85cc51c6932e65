"""Verdicts on sweeps whose outcome is chosen: returns, stability, order, sensitivity, profiles."""

import dataclasses

import numpy as np
import pyarrow as pa
import pytest

from galton_experiments.runs import Summary
from studies.paper import order, returns
from studies.paper.claims import CLAIMS
from studies.paper.measures import better, by_setting, final_return, over_regression
from studies.paper.prose import text
from studies.paper.registry import FIGURES
from studies.paper.report import claims
from studies.paper.sweeps import needed
from studies.paper.trained import Trained

from . import made_up
from .made_up import SWEEPS

PROPOSITIONS = "§4.3, Propositions 1 and 2"
CLASSIFIED = ("hl-one-hot", "hl-gauss", "hl-gauss-centred")
LQR = ("lqr", "lqr-again")


def judged(claim, final_of, **options):
    return claim(made_up.judgeable(final_of, **options)).verdict


def winning(loss):
    return lambda _, setting: 5.0 if setting["loss"] == loss else 1.0


def line(claim, name):
    """The line of a claim's unit, without its mark, and the mark."""
    (found,) = [text for text in claim.number.splitlines() if text[2:].startswith(name)]
    return found[0], found[2:]


def test_classification_that_wins_somewhere_holds_in_part():
    def mixed(name, setting):
        return winning("hl-gauss" if name.startswith(("lqr", "reacher")) else "gaussian")(name, setting)

    tasks = [f"{task}{part}" for task in ("lqr", "reacher", "ant", "bandit") for part in ("", "-again")]
    part = returns.ends_higher(made_up.judgeable(mixed, names=tasks))
    assert (part.verdict, part.count) == ("holds in part", (2, 4))
    assert line(part, "LQR")[0] == "✓"
    assert line(part, "Bandit")[0] == "✗"


def test_one_run_that_fails_does_not_hide_that_the_others_are_higher():
    """A t interval of the difference leaves 0 in; ranks don't."""

    def one_fails(finals):
        return np.concatenate([finals[:-1], finals[-1:] - 40])

    data = made_up.judgeable(winning("hl-gauss"), LQR)
    worse = with_finals(data, "lqr-again", "training_return", ["gaussian"], one_fails)
    found = over_regression(worse.judged["lqr"])
    assert found.difference.low < 0 < found.difference.high
    assert returns.ends_higher(worse).verdict == "holds"


def test_a_task_on_which_nobody_learns_is_listed_and_not_counted():
    def final_of(name, setting):
        return -1.0 - 5 * (setting["loss"] == "gaussian") if name.startswith("mountain") else 1.0

    claim = returns.ends_higher(made_up.judgeable(final_of, (*LQR, "mountain-car", "mountain-car-again")))
    n = len(SWEEPS["mountain-car"].study("smoke", {}).settings) * 12
    assert line(claim, "Mountain Car") == ("∅", f"Mountain Car null: 0 of {n} runs ever earn more than rest")
    assert claim.count == (0, 1)


def test_the_better_loss_is_chosen_by_other_runs_than_it_is_judged_by():
    """On the grid HL-1-Hot is better; on fresh seeds HL-Gauss is, and alone beats the Gaussian."""

    def lucky(name, setting):
        return 3.0 if setting["loss"] == ("hl-gauss" if name.endswith("-again") else "hl-one-hot") else 1.0

    task = made_up.judgeable(lucky, LQR).judged["lqr"]
    assert better(task.chosen, final_return) == "hl-one-hot"
    assert abs(over_regression(task).difference.mean) < 0.1


def with_finals(data, name, metric, losses, change):
    """The data with other final numbers of some losses in one sweep."""
    summary = data.sweeps[name]
    rows = summary.rows(*(setting for setting in summary.study.settings if setting["loss"] in losses))
    finals = summary.final(metric)
    finals[rows] = change(finals[rows])
    return with_column(data, name, f"final_{metric}", pa.array(finals.astype(np.float32)))


def with_column(data, name, column, values):
    """The data where a sweep has another column, or one more."""
    summary = data.sweeps[name]
    names = summary.table.column_names
    table = summary.table.drop_columns([column]) if column in names else summary.table
    changed = dataclasses.replace(summary, table=table.append_column(column, values))
    return dataclasses.replace(data, sweeps=data.sweeps | {name: changed})


def with_curves(data, name, metric, curves):
    """The data where a sweep has other curves, or those of one more metric."""
    flat = pa.array(curves.astype(np.float32).ravel())
    return with_column(data, name, metric, pa.FixedSizeListArray.from_arrays(flat, curves.shape[1]))


def test_without_fresh_seeds_nothing_is_judged():
    data = made_up.judgeable(winning("hl-gauss"), ("lqr", "mountain-car"))
    for claim in (returns.ends_higher, returns.learns_sooner, order.alike_between_seeds, order.order_changes):
        assert claim(data).verdict == "not decidable here"


def test_where_the_softmax_loses_its_entropy_is_told_and_where_nobody_gains_that():
    data = made_up.judgeable(lambda _, s: 1.0 if s["loss"] in CLASSIFIED else 3.0, LQR)
    why = returns.ends_higher(data).why
    assert ", LQR -25.0 of 6.0 nats" in f", {why.split('lower: ')[1]}"  # all that is logged is made up alike; 2 log 20
    idle = made_up.judgeable(lambda _, s: -1.0 if s["loss"] in CLASSIFIED else 3.0, LQR)
    assert "acting at random: LQR (HL-1-Hot, HL-Gauss)." in returns.ends_higher(idle).why


def test_without_the_noise_of_exploration_the_order_may_be_another():
    data = made_up.judgeable(winning("hl-gauss"), LQR)
    quiet = with_finals(data, "lqr-again", "evaluation_return", ["gaussian"], lambda finals: finals + 100)
    claim = returns.ends_higher(quiet)
    assert claim.verdict == "holds"
    assert "By the deterministic policy's return (most likely action): 1 clearly the contrary (LQR)." in claim.why
    assert "mean action" not in claim.why


def test_where_the_mean_action_was_evaluated_it_is_judged_too():
    data = made_up.judgeable(winning("hl-gauss"), LQR)
    evaluated = data.sweeps["lqr-again"].final("evaluation_return")
    both = with_column(data, "lqr-again", "final_mean_action_return", pa.array(evaluated.astype(np.float32)))
    curves = data.sweeps["lqr-again"].curves("evaluation_return")
    both = with_curves(both, "lqr-again", "mean_action_return", curves)
    told = "By the deterministic policy's return (mean action): 1 as the paper says (LQR)."
    for claim in (returns.ends_higher, returns.learns_faster, returns.learns_sooner):
        assert told in claim(both).why


def test_who_is_sooner_may_have_less_over_training():
    """The Gaussian starts low, but is a quarter of the way in step 200, the others in 300."""
    data = made_up.judgeable(lambda *_: 1.0, LQR)
    summary, scale = data.sweeps["lqr-again"], data.scales["lqr"]
    shares = np.repeat([[0.0, 0.2, 0.3, 0.5, 0.5, 0.5]], len(summary.setting), axis=0)
    shares[summary.rows(summary.best["gaussian"].setting)] = [-9.0, 0.3, 0.3, 0.5, 0.5, 0.5]
    noise = np.random.default_rng(0).uniform(0, 0.01, shares.shape)
    curves = scale.rest + (shares + noise) * (scale.best - scale.rest)
    late = with_curves(data, "lqr-again", "training_return", curves)
    assert returns.learns_faster(late).verdict == "holds"
    claim = returns.learns_sooner(late)
    assert claim.verdict == "does not hold"
    assert line(claim, "LQR")[1].startswith("LQR 80 and 160, P = 0.00, p < 0.001")
    never = with_curves(data, "lqr-again", "training_return", np.where(shares < 0, curves, scale.rest))
    assert "LQR never and never, P = 0.50" in returns.learns_sooner(never).number


def test_centred_hl_gauss_counts_for_nothing_in_the_papers_claims():
    assert judged(returns.ends_higher, winning("hl-gauss-centred")) == "not decidable here"


def test_drawdown_is_told_as_a_share_of_the_way():
    """The best log point is where it was; the end is 3 below."""
    data = made_up.judgeable(lambda *_: 1.0, LQR)
    fallen = with_finals(data, "lqr-again", "training_return", ["gaussian"], lambda finals: finals - 3)
    assert "0.18 ± 0.00" in order.keeps_what_it_learns(fallen).number  # of 16.26 from rest to the optimum


def ahead(name, setting):
    return winning("hl-gauss" if name.startswith("lqr") else "hl-one-hot")(name, setting)


def test_orders():
    assert judged(order.order_changes, winning("hl-gauss")) == "does not hold"
    assert judged(order.order_changes, ahead, names=(*LQR, "reacher", "reacher-again")) == "holds in part"
    alike = (*LQR, "reacher", "reacher-again")
    assert judged(order.order_changes, lambda *_: 1.0, names=alike) == "holds in part"
    assert judged(order.order_changes, lambda *_: 1.0, names=LQR) == "not decidable here"
    assert judged(order.order_changes, lambda *_: 1.0, names=LQR, noise=5.0) == "not decidable here"
    near = made_up.judgeable(lambda *of: 16 + 0.05 * ahead(*of), (*LQR, "reacher", "reacher-again"))
    assert order.order_changes(near).verdict == "holds"
    assert "HL-Gauss is clearly ahead: LQR. HL-1-Hot: Reacher." in order.order_changes(near).why


def test_hl_gauss_that_is_hl_one_hot_has_no_order():
    narrow = made_up.judgeable(lambda _, s: 5 - s["eta"], LQR, budget="paper")
    claim = order.order_changes(narrow)
    assert claim.verdict == "not decidable here"
    assert line(claim, "LQR") == ("∅", "LQR the same loss: HL-Gauss's best η is at most 0.1")


def test_a_run_that_diverged_counts_as_the_worst():
    study = SWEEPS["lqr"].study("smoke", {})
    table = made_up.results(study, lambda _: 1.0, diverged=[0, 1])
    summary = Summary.of_results(study, table, made_up.PROVENANCE)
    assert study.settings[0]["loss"] == "gaussian"
    first = by_setting(summary, "gaussian")[0]
    np.testing.assert_array_equal(first, np.nanmin(summary.curves("training_return")))


def test_without_data_nothing_is_decided():
    found = claims(Trained({}))
    assert {claim.verdict for claim in found} == {"not decidable here"}
    assert {claim.count for claim in found} == {None}


@pytest.mark.parametrize(
    "name", [pytest.param(name, marks=pytest.mark.slow if i % 4 else ()) for i, name in enumerate(SWEEPS)]
)
def test_every_claim_can_be_judged_from_any_one_sweep(name):
    """And from those whose winners it trains; the smoke test's runs are too few to decide anything."""
    data = made_up.data(lambda *_: 1.0, [sweep.name for sweep in needed([SWEEPS[name]])])
    for some in (Trained({name: data.sweeps[name]}), data):
        assert {claim.verdict for claim in claims(some)} == {"not decidable here"}


def test_claims_stand_in_the_order_of_the_paper_and_rest_on_their_figures():
    names = [getattr(judge, "func", judge).__name__ for _, judge in CLAIMS]
    assert [*dict.fromkeys(names), "ends_higher_without_noise"] == [*text("claims")]
    assert {name for name, _ in CLAIMS} <= {*FIGURES}
    found = {claim.source: claim.section for claim in reversed(claims(Trained({})))}
    assert [*found][-1] == "§1, §5.2.1"
    assert (found["§1, §5.2.1"], found[PROPOSITIONS], found["App. C.4"]) == ("figure-2", "propositions", "figure-7")
