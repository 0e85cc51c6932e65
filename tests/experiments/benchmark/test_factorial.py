"""A factorial benchmark reads its runs at equal steps and at equal time, and tells what they say."""

import functools
import json

import numpy as np
import pyarrow as pa
import pytest

from galton_experiments.analysis.factorial import factorial
from galton_experiments.benchmark import factorial as benchmark_factorial
from galton_experiments.benchmark import factorial_page, page, stages
from galton_experiments.benchmark.answer import sentences
from galton_experiments.benchmark.draws import draws
from galton_experiments.benchmark.factorial import answers, stacked
from galton_experiments.benchmark.found import Found
from galton_experiments.benchmark.runs import Runs
from galton_experiments.benchmark.standings import with_worst
from galton_experiments.page.page import Table

from .files import FACTORIAL, protocol

ANCHORS = {"anchors": {"usual": {"learning_rate": 0.1}}, "budget__settings": 4, "budget__logs": 10}
KNOWN = protocol(**FACTORIAL, **ANCHORS)


@pytest.fixture(autouse=True)
def _few_resamples(monkeypatch):
    monkeypatch.setattr(benchmark_factorial, "factorial", functools.partial(factorial, n_resamples=500))


STEPS = np.arange(10, 101, 10)
SPEEDS = {task.name: {"gaussian": 300.0, "bins": 150.0, "ppo": 600.0} for task in KNOWN.tasks}


def found(better, known=KNOWN, speeds=SPEEDS, diverged_at=-1):
    """Every run's curve rises to its end, which is so much higher for each method than for the one before."""
    drawn, rng, runs = draws(known), np.random.default_rng(7), []
    for part in stages.tuning(known, drawn):
        rows = [(entry, trial) for entry in part.entries for trial in range(part.trials)]
        finals = [better * ("gaussian", "bins", "ppo").index(entry.method) + rng.normal() for entry, _ in rows]
        gone = [diverged_at if entry.method == "ppo" else -1 for entry, _ in rows]
        judged = [final + STEPS - 100.0 for final in finals]
        table = pa.table(
            {"final_judged": np.where(np.array(gone) >= 0, np.nan, finals), "diverged_at": gone, "judged": judged}
            | {"steps": [STEPS] * len(rows), "final_step": [100] * len(rows)}
        )
        runs.append(Runs(part, table))
    return Found(known, drawn, runs, speeds=speeds)


def test_it_has_one_stage_with_every_draw_on_every_task():
    parts = stages.tuning(KNOWN, draws(KNOWN))
    assert [(part.name, part.trials, len(part.entries)) for part in parts] == [
        (f"tuning-{task}", 2, 12) for task in ("bandit", "noisy", "four")
    ]
    assert stages.afterwards(KNOWN, draws(KNOWN), found(3.0).selected) == []


def test_a_method_whose_step_takes_twice_as_long_is_read_at_half_of_its_steps():
    known = found(0.0)
    runs = known.tuning[0]
    late = runs.finals("bins", "draw")
    np.testing.assert_allclose(runs.finals_at("bins", 0.5, 0.1), late - 50, rtol=1e-6)
    np.testing.assert_allclose(runs.finals_at("bins", 0.55, 0.1), late - 50, rtol=1e-6)  # no point beyond its time
    np.testing.assert_allclose(runs.finals_at("bins", 0.01, 0.1), late - 90, rtol=1e-6)  # the first there is
    np.testing.assert_allclose(runs.finals_at("bins", 0.5, 0.4), late - 55, rtol=1e-6)  # of five points the last two
    assert known.factorial.times["bins"] == pytest.approx(dict.fromkeys(("bandit", "noisy", "four"), 2))
    assert known.factorial.times["ppo"] == pytest.approx(dict.fromkeys(("bandit", "noisy", "four"), 0.5))


def test_a_run_that_diverges_after_it_is_read_counts():
    runs = found(0.0, diverged_at=70).tuning[0]
    assert np.isnan(runs.finals_at("ppo", 1.0, 0.1)).all()
    assert np.isfinite(runs.finals_at("ppo", 0.5, 0.1)).all()
    assert np.isnan(runs.finals_at("ppo", 0.8, 0.1)).all()


def test_where_no_episode_has_ended_when_it_is_read_equal_time_says_nothing():
    known = found(0.0)
    for runs in known.tuning:
        late = [np.where(np.array(curve) < curve[-1] - 40, np.nan, curve) for curve in runs.table["judged"].to_pylist()]
        object.__setattr__(runs, "table", runs.table.set_column(2, "judged", [late]))
    assert known.tuning[0].finals_at("bins", 0.5, 0.1) is None
    assert {*answers(KNOWN, known.tuning, known.scores, SPEEDS).equal_time} == set()
    nearly = {task: {"gaussian": 300.0, "bins": 250.0, "ppo": 900.0} for task in SPEEDS}
    assert {*answers(KNOWN, known.tuning, known.scores, nearly).equal_time} == {"bins"}


def test_at_equal_time_the_slow_method_is_behind_and_the_fast_one_ahead():
    known = found(3.0).factorial
    assert (known.equal_steps.same_draw.mean[1:] > 0.9).all()
    assert known.equal_time["bins"].same_draw.mean[1] == 0
    assert known.equal_time["ppo"].same_draw.mean[1] == 1


def test_the_file_may_say_how_long_a_step_takes_and_without_both_nothing_is_told():
    given = protocol(**FACTORIAL, **ANCHORS, methods__bins__time=1.25)
    assert found(0.0, given, {}).factorial.times == {"bins": dict.fromkeys(("bandit", "noisy", "four"), 1.25)}
    assert found(0.0, given).factorial.times["bins"]["noisy"] == 1.25
    unknown = found(1.0, speeds={})
    assert unknown.factorial.equal_time == {}
    assert {row[3] for row in factorial_page.above(unknown).rows} == {"—"}
    assert "equal time" not in " ".join(sentences(unknown))


def test_steps_as_long_as_the_baselines_change_nothing():
    same = {task.name: dict.fromkeys(("gaussian", "bins", "ppo"), 100.0) for task in KNOWN.tasks}
    known = found(1.0, speeds=same)
    answered = answers(KNOWN, known.tuning, known.scores, same)
    for name in ("one_setting", "per_task", "top_quarter", "same_draw"):
        assert getattr(answered.equal_time["bins"], name).mean[1] == getattr(answered.equal_steps, name).mean[1]
    assert stacked(known.scores, ["bins"]).shape == (1, 4, 3, 2)


def test_the_page_and_the_record_have_all_answers():
    known = found(3.0, diverged_at=70)
    drawn = page.figures(known)
    text = page.page(known, drawn)
    assert [*drawn] == ["same-draw", "best-of-n"]
    for words in ("P(above Gaussian) on each task", "one setting, equal time", "bins − Gaussian", "0, usual"):
        assert words in text
    above = factorial_page.above(known)
    assert isinstance(above, Table)
    assert [row[0] for row in above.rows] == ["bins"] * 4 + ["ppo"] * 4
    assert [row[1] for row in factorial_page.above_by_task(known).rows[::2]] == [
        row[1] for row in above.rows if row[1] != "same draw"
    ]
    record = json.loads(json.dumps(known.record()))
    assert record["selected"]["shared"].keys() == {"gaussian", "bins", "ppo"}
    assert record["factorial"]["equal_steps"]["one_setting"]["mean"][0] == 0.5
    said = sentences(known)
    assert said[0].startswith("With the best quarter of draws bins is above Gaussian with P = ")
    assert said[-1].endswith("There are 3 tasks, too few for anything to be clear.")
    rows = factorial_page.drawn(known).rows
    runs = {name: known.tuning[0].finals(name, "draw") for name in ("gaussian", "bins", "ppo")}
    assert rows[0][3] == f"{with_worst(runs)['gaussian'][0].mean():,.3f}".replace("-", "−")


def test_with_tasks_enough_it_is_said_who_is_clearly_ahead():
    more = {f"tasks__more{i}": {"env": "bandit", "env_kwargs": {"noise_std": float(i)}} for i in range(1, 6)}
    many = protocol(**FACTORIAL, **ANCHORS, **more)
    for better, words in ((30.0, "clearly ahead"), (-30.0, "clearly behind"), (0.0, "Neither is clearly ahead")):
        said = sentences(found(better, many, {}))
        assert all(words in each for each in said[:2])
