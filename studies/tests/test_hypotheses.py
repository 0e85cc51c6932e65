"""The claims again under each change, on sweeps whose outcome is chosen."""

import dataclasses

import numpy as np
import pyarrow as pa
import pytest

from galton.tasks import TASKS
from galton_experiments.sweep.grid import task_defaults
from galton_experiments.sweep.study import Setting
from studies.paper import changes, hypotheses, report, rescaling
from studies.paper.prose import text
from studies.paper.trained import Trained

from . import made_up

CHANGES = [change for of in changes.CHANGES.values() for change in of]


@pytest.mark.parametrize("change", CHANGES, ids=[change.name for change in CHANGES])
def test_a_change_sets_what_it_names_and_nothing_else(change):
    for task in change.tasks:
        own = dict(change.fields) | dict(change.of_task.get(task, {}))
        base = Setting(task_defaults(TASKS[task].env)).record()
        for setting in change.settings(task, "paper"):
            record = setting.record()
            free = {"loss", "learning_rate", "n_bins", "eta"}
            assert all(record[name] == value for name, value in own.items() if name in record)
            assert {name for name in record if record[name] != base.get(name)} <= {*own, *free}
        assert {setting["loss"] for setting in change.settings(task, "paper")} == {*change.losses}


def floored(name, setting):
    """The Gaussian is ahead, unless σ has a floor."""
    has_floor = np.isfinite(setting["log_std_min"])
    return 5.0 if setting["loss"] == "gaussian" and not has_floor else 1.0 if has_floor else 3.0


@pytest.fixture(scope="module")
def trained():
    return made_up.judgeable(floored)


def test_a_floor_turns_the_claim_and_leaves_the_other_losses_as_they_were(trained):
    table = hypotheses.table(trained)
    place = table.columns.index("ends higher")
    main, floor = (table.rows[name][place] for name in ("as in the main experiment", "(c) σ at least 0.1"))
    assert main.verdict == "does not hold"
    assert floor.verdict == "holds"
    assert "as in the main experiment" not in table.heads
    heads = {name: table.heads[name][0] for name in ("(c) σ at least 0.1", "λ = 0.95")}
    assert heads == {"(c) σ at least 0.1": text("hypotheses")["c"]["title"], "λ = 0.95": "The earlier study, why."}
    under = hypotheses.under(trained, changes.CHANGES["c"][0].variant)
    for task, judged in under.judged.items():
        again, main = judged.again, trained.judged[task].again
        setting = main.best["hl-gauss"].setting
        assert again.best["hl-gauss"].setting == setting
        np.testing.assert_array_equal(
            again.final("training_return")[again.rows(setting)],
            main.final("training_return")[main.rows(setting)][: again.study.trials],
        )


def test_every_hypothesis_has_a_row_and_every_row_its_tasks(trained):
    table = hypotheses.table(trained)
    assert {name[1] for name in table.rows if name.startswith("(")} == {*text("hypotheses")} - {"why"} == {*"abcdefgh"}
    assert table.rows["(g) η in units of the action"][0].text == "LQR, Mountain Car, Acrobot"


def test_the_tables_that_documents_quote_are_markdown_with_a_sign_for_each_verdict(trained):
    lines = report.document(trained).splitlines()
    assert "## What makes the paper's result appear?" in lines
    row = next(line for line in lines if line.startswith("| (c) σ at least 0.1 |"))
    assert "| ✓ " in row
    assert {line.count("|") for line in lines if line.startswith("| (")} == {len(hypotheses.CLAIMS) + 3}
    assert "|" not in report.document(Trained({}))


def test_the_bandit_in_units_of_its_box_is_judged_by_its_own_runs():
    def in_the_box(name, setting):
        return 20.0 if setting["loss"] == ("hl-gauss" if name.startswith("boxed") else "gaussian") else 10.0

    trained = made_up.judgeable(in_the_box)
    words = next(words for words in rescaling.table(trained).rows if words.startswith("Both classification losses"))
    raw, box = rescaling.table(trained).rows[words]
    assert raw.text.startswith("0 of")
    assert not box.text.startswith("0 of")


def nudged(at, name):
    """The same setting in a sweep whose runs end one bit higher by this number."""
    summary = at.summary
    finals = np.nextafter(summary.final(name).astype(np.float32), np.float32(9))
    place = summary.table.column_names.index(f"final_{name}")
    table = summary.table.set_column(place, f"final_{name}", pa.array(finals))
    return at._replace(summary=dataclasses.replace(summary, table=table))


def test_runs_are_equal_across_scales_only_if_no_bit_differs():
    trained = made_up.data(lambda name, setting: 1.0, noise=0.0)
    series = rescaling.across(trained, "lqr")
    for name in ("hl-gauss", "gaussian", rescaling.IN_THE_BOX):
        runs, in_box = series[name], name == rescaling.IN_THE_BOX
        assert rescaling.are_equal(runs)
        for column, matters in (("sigma", False), ("entropy", not in_box), ("training_return", True)):
            assert rescaling.are_equal(runs | {8.0: nudged(runs[8.0], column)}) != matters
    assert rescaling.draw(trained).axes


def test_a_diverged_run_at_some_scale_counts_as_the_worst_of_all_losses_there():
    """Also where every run of a loss diverged, which then has none to be filled with."""
    at = rescaling.across(made_up.data(lambda name, setting: 1.0, noise=0.0), "lqr")["hl-gauss"][8.0]
    runs = at.summary.rows(at.setting)
    columns = {name: at.summary.table[name].to_numpy().copy() for name in ("diverged_at", "final_training_return")}
    columns["diverged_at"][runs], columns["final_training_return"][runs] = 1, np.nan
    table = at.summary.table
    for name, values in columns.items():
        table = table.set_column(table.column_names.index(name), name, pa.array(values))
    lost = at._replace(summary=dataclasses.replace(at.summary, table=table))
    assert not np.isnan(at.final("training")).any()
    assert (lost.final("training") <= at.final("training")).all()


def test_without_the_lowest_rate_the_winners_are_others():
    def lowest(name, setting):
        return 5.0 if setting["learning_rate"] < 5e-4 and setting["loss"] == "gaussian" else 3.0

    trained = made_up.judgeable(lowest)
    main, without = trained.judged["reacher"], hypotheses.under(trained, changes.WITHOUT_LOWEST).judged["reacher"]
    rates = [each.again.best["gaussian"].setting["learning_rate"] for each in (main, without)]
    assert rates[0] < rates[1]
    assert without.again.best["hl-gauss"].setting["learning_rate"] > min(
        setting["learning_rate"] for setting in main.chosen.study.settings
    )
