"""What a benchmark tells of itself, from runs that were never trained."""

import dataclasses

import pyarrow as pa
import pytest

from galton_experiments.analysis.plain import plain
from galton_experiments.benchmark import figures, tables
from galton_experiments.benchmark.answer import sentences
from galton_experiments.benchmark.draws import draws
from galton_experiments.benchmark.found import Found

from .files import protocol
from .made_up import KNOWN, made_up


def found(better, stages=("fresh", "held-out")):
    return Found(KNOWN, draws(KNOWN), [], {stage: made_up(stage, better)[0] for stage in stages})


@pytest.mark.parametrize(
    ("better", "first", "near", "clear"),
    [
        (
            4.0,
            "ppo has the highest score on the tuning tasks, fresh seeds.",
            "none.",
            "clearly better on four and clearly worse on none",
        ),
        (
            -4.0,
            "No method has a higher score than Gaussian on the tuning tasks",
            "none.",
            "clearly better on none and clearly worse on four",
        ),
        (0.0, "", "", "clearly better on none and clearly worse on none"),
    ],
)
def test_the_answer_says_who_is_ahead_and_what_held_out_tasks_say_of_it(better, first, near, clear):
    said = sentences(found(better))
    assert said[0].startswith(first)
    assert said[1].startswith(f"Not clearly behind it: {near}")
    assert said[2].startswith("On the held-out tasks, ")
    assert "Of 1 it is " + clear in said[2]
    assert len(said) == 3


def test_of_equal_methods_the_baseline_is_not_behind():
    known = found(0.0)
    same = known.standings["fresh"].scores["gaussian"]
    known.standings["fresh"] = dataclasses.replace(
        known.standings["fresh"], scores=dict.fromkeys(("ppo", "bins", "gaussian"), same)
    )
    assert sentences(known)[0].startswith("No method has a higher score than Gau")


def test_methods_that_may_be_as_good_as_the_first_are_named():
    known = found(0.0)
    above, labels = known.standings["fresh"].above, {"gaussian": "Gaussian", "bins": "bins", "ppo": "ppo"}
    first = max(known.standings["fresh"].scores.items(), key=lambda each: each[1]["shared"].judged.mean)[0]
    wider = 3.314 / 2.772  # of 3 and 2 means, from tables of the studentised range
    lows = {name: versus.mean - wider * (versus.mean - versus.low) for name, versus in above[first].items()}
    near = {labels[name] for name, low in lows.items() if low <= 0.5}
    assert near
    assert set(sentences(known)[1].removeprefix("Not clearly behind it: ").removesuffix(".").split(", ")) == near


def test_without_held_out_tasks_the_answer_says_that_its_seeds_flatter():
    said = sentences(found(4.0, ("fresh",)))
    assert said[2].startswith("On the tuning tasks, fresh seeds, ppo is above Gaussian")
    assert said[2].endswith("The same seeds chose it, which flatters it.")


@pytest.mark.parametrize("n", [1, 3])
def test_with_too_few_seeds_nothing_is_clear(n):
    few = protocol(budget__fresh_seeds=n)
    later = {stage: made_up(stage, 4.0, few)[0] for stage in ("fresh", "held-out")}
    said = sentences(Found(few, draws(few), [], later))
    assert said[2].endswith("There are too few fresh seeds for anything to be clear on a task by itself.")
    if n == 1:
        assert said[1] == "There are too few fresh seeds to say which methods are behind it."


def equal(runs):
    rows = [-500.0] * runs.table.num_rows
    table = pa.table({"final_judged": rows, "final_training": rows, "diverged_at": [-1] * len(rows)})
    return dataclasses.replace(runs, table=table)


def test_where_all_runs_are_equal_figures_are_drawn():
    known = found(1.0)
    later = {stage: [equal(each) for each in runs] for stage, runs in known.later.items()}
    assert figures.scores(dataclasses.replace(known, later=later)).axes


def test_of_many_methods_the_baseline_and_those_ahead_are_drawn(monkeypatch):
    known = found(1.0)
    assert [method.name for method in figures.leading(known)] == ["gaussian", "bins", "ppo"]
    assert figures.few(known) == ""
    monkeypatch.setattr(figures, "MOST_CURVES", 2)
    assert [method.name for method in figures.leading(known)] == ["gaussian", "ppo"]
    assert figures.few(known) == "Of all methods 2 are drawn: the baseline and those with the highest scores."


def test_before_fresh_seeds_there_is_no_answer():
    assert "have not judged yet" in sentences(found(0.0, ()))[0]
    assert "not all tuning tasks" in sentences(found(0.0, ("held-out",)))[0]


def test_tables_have_a_row_for_each_method_and_task():
    known = found(1.0)
    assert [row[0] for row in tables.scores(known, "fresh").rows] == ["Gaussian", "bins", "ppo"]
    for heading in ("sensitivity", "P(above), own settings"):
        assert heading in tables.scores(known, "fresh").headings
        assert heading not in tables.scores(known, "held-out").headings
    assert len(tables.returns(known, "fresh").rows) == 2 * 3 * 2
    assert [row[0] for row in tables.returns_in_brief(known, "fresh").rows][:5] == [
        *("bandit", "  Gaussian", "  bins", "  ppo (1 diverged)"),
        "noisy",
    ]
    pairs = tables.pairs(known, "held-out").rows
    assert [row[i + 1] for i, row in enumerate(pairs)] == ["—"] * 3
    versus = known.standings["fresh"].above
    assert pairs[2][1].split(" ")[0] == f"{known.standings['held-out'].above['ppo']['gaussian'].mean:.2f}"
    assert versus["ppo"]["gaussian"].mean == pytest.approx(1 - versus["gaussian"]["ppo"].mean)


def test_the_table_of_priors_says_who_draws_what():
    rows = tables.prior(found(0.0)).rows
    assert ["eta", "bins", "log-uniform 0.25 … 4"] in rows
    assert ["decay_steps", "all that have a use for it", "0, 0.5 × steps"] in rows


def test_what_is_not_finite_is_null_in_json():
    assert plain({"a": (float("nan"), 1.5), "b": [float("-inf")]}) == {"a": [None, 1.5], "b": [None]}


def test_it_says_how_many_runs_there_were_of_what_and_what_no_draw_changed():
    known = found(0.0)
    said = tables.trained(known)
    assert said.startswith("Each draw has 2 seeds on each tuning task, and what is selected has 8 fresh seeds on every")
    assert "by its mean deterministic return over the last 10% of its log points. The baseline is Gaussian." in said
    assert tables.tasks(known).rows[1:] == [
        ["noisy", "bandit(noise_std=5.0)", "200", "300", "2", "1"],
        ["four", "bandit(d=4)", "held out", "100", "2", "1"],
    ]
    rows = tables.fixed(known).rows
    assert rows[:2] == [["all, unless said below", "n_steps 5, net_arch []"], ["Gaussian", "loss gaussian"]]
    assert rows[-1] == ["all on noisy", "n_envs 2"]
