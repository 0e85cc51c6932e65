"""The command that trains, draws and tells, at its smallest budget."""

import contextlib
import dataclasses
import os
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pyarrow as pa
import pytest
from matplotlib.figure import Figure

from galton.errors import UsageError
from galton.saving.provenance import machine, versions
from galton.tasks import TASKS
from galton_experiments.runs import Summary
from galton_experiments.sweep.parquet import record_of, to_bytes, with_record
from studies.paper import made, report, reproduce
from studies.paper.__main__ import asked, main
from studies.paper.figure import FigureStudy
from studies.paper.gradients import Sample
from studies.paper.registry import FIGURES
from studies.paper.report import claims
from studies.paper.sweeps import AGAIN, MAIN, Sweep, again, needed
from studies.paper.trained import Trained
from studies.paper.verdicts import claim

from . import made_up
from .made_up import SWEEPS

ROOT = Path(__file__).parents[2]


def command(*arguments, cwd=ROOT, timeout=1800):
    line = [sys.executable, "-m", "studies.paper", *map(str, arguments)]
    return subprocess.run(line, capture_output=True, text=True, timeout=timeout, cwd=cwd)


@pytest.fixture
def told(monkeypatch, capsys):
    """The exit code of a command in this process, and what it tells on stderr."""

    def run(*arguments):
        monkeypatch.setattr(sys, "argv", ["studies.paper", *map(str, arguments)])
        code = 0
        try:
            main()
        except SystemExit as end:
            code = end.code
        return code, capsys.readouterr().err

    return run


def files(folder):
    return {str(path.relative_to(folder)): path.read_bytes() for path in sorted(folder.rglob("*")) if path.is_file()}


RESULTS = ROOT / "results"
PART = ["figure-1", "figure-9"]
"""Two tasks in JAX, each with its fresh seeds, and a figure without data."""


@pytest.fixture(scope="module")
def part(tmp_path_factory):
    """A part of the paper, as a user asks for it."""
    out = tmp_path_factory.mktemp("part") / "paper"
    done = command("reproduce", *PART, "--budget", "smoke", "--out", out)
    assert done.returncode == 0, done.stderr
    return out


def test_a_part_of_the_paper_at_the_smallest_budget(part):
    sweeps, figures = asked(PART)
    assert set(reproduce.load(str(part)).sweeps) == {sweep.name for sweep in needed(sweeps)}
    check_page(part, figures)
    assert "Not trained here" in (part / "index.html").read_text()


@pytest.mark.slow
def test_all_of_it_at_the_smallest_budget(part, tmp_path):
    """In three commands, of which none trains again what is there; each does about half of what there is or less."""
    out = tmp_path / "all"
    shutil.copytree(part, out)
    for what in ([name for name in FIGURES if name != "hypotheses"], ["all"]):
        known = {path.name: path.stat().st_mtime for path in (out / reproduce.DATA).iterdir()}
        done = command("reproduce", *what, "--budget", "smoke", "--out", out)
        assert done.returncode == 0, done.stderr
        assert {name: (out / reproduce.DATA / name).stat().st_mtime for name in known} == known
    assert set(reproduce.load(str(out)).sweeps) == set(SWEEPS)
    check_page(out, FIGURES)
    assert "Not trained here" not in (out / "index.html").read_text()


def check_page(folder, figures):
    for name in figures:
        assert (folder / "figures" / f"{name}.png").stat().st_size > 5_000
        assert (folder / "figures" / f"{name}.svg").stat().st_size > 5_000
    page = (folder / "index.html").read_text()
    assert all(f'id="{name}"' in page for name in figures)
    assert len(page) < 5_000_000


@pytest.mark.parametrize("page", sorted(RESULTS.glob("*/index.html")), ids=lambda page: page.parent.name)
def test_a_page_that_is_published_is_below_5_mb(page):
    assert page.stat().st_size < 5_000_000


@pytest.mark.slow
@pytest.mark.parametrize("words", [["reproduce", *PART, "--budget", "smoke", "--out"], ["report"]], ids=str)
def test_the_summaries_alone_give_the_same_page_without_training(part, tmp_path, words):
    shutil.copytree(part / reproduce.DATA, tmp_path / reproduce.DATA)
    done = command(*words, tmp_path)
    assert done.returncode == 0, done.stderr
    assert not (tmp_path / "sweeps").exists()
    assert {name: data for name, data in files(part).items() if not name.startswith("sweeps")} == files(tmp_path)


def test_another_budget_in_the_same_folder_is_refused(part, told):
    code, errors = told("reproduce", "propositions", "lqr", "--budget", "small", "--out", part)
    assert (code, errors.count("\n")) == (2, 1)
    assert "whose lqr was made with budget 'smoke', not 'small'" in errors


@pytest.mark.parametrize(
    ("arguments", "complaint"),
    [
        (["reproduce", "figure-11"], "'figure-11' is nothing to reproduce; choose from figure-1, "),
        (["report", "nowhere"], "folder is 'nowhere', which holds no data; make some with: python -m studies.paper"),
    ],
)
def test_wrong_words_are_one_line(arguments, complaint, told):
    code, errors = told(*arguments)
    assert (code, errors.count("\n")) == (2, 1)
    assert complaint in errors


def test_words_ask_for_sweeps():
    everything, figures = asked(["all"])
    assert {sweep.name for sweep in everything} == set(SWEEPS)
    assert figures == FIGURES
    assert asked(["figure-3"]) == (list(FIGURES["figure-3"].sweeps), {"figure-3": FIGURES["figure-3"]})
    assert asked(["analytic"])[0] == [sweep for task in list(TASKS)[:4] for sweep in (MAIN[task], AGAIN[task])]
    sweeps, figures = asked(["ant", "propositions"])
    assert ([sweep.name for sweep in sweeps], [*figures]) == (["ant", "ant-again"], ["propositions"])
    sweeps, figures = asked(["hypotheses-lqr-again", "scale-lqr-*"])
    scales = [f"scale-lqr-{scale}" for scale in (0.125, 0.5, 1, 2, 8)]
    assert {sweep.name for sweep in sweeps} == {"hypotheses-lqr-again", *scales}
    assert figures == {}
    with pytest.raises(UsageError, match="'cart-pole' is nothing to reproduce"):
        asked(["lqr", "cart-pole"])


def samples(**changed):
    """A table of one sample that was never measured."""
    row = {"task": "lqr", "loss": "gaussian", "reading": "sigma", "step": 20, "swept": False, "factor": 1.0}
    row |= {"seed": 0, "sample": 0} | dict.fromkeys(Sample._fields, np.float32(1))
    return pa.table({name: [value] for name, value in (row | changed).items() if value is not None})


def test_what_a_figure_measured_is_kept_and_refused_at_another_budget(tmp_path):
    calls, told = [], []

    def measure(budget):
        calls.append(budget)
        return samples()

    figures = {"propositions": dataclasses.replace(FIGURES["propositions"], measure=measure)}
    for _ in range(2):
        reproduce.measure(figures, "smoke", str(tmp_path), told.append)
    assert (calls, told) == (["smoke"], ["measurement 1 of 1: propositions"])
    known = record_of(reproduce.load(str(tmp_path)).tables["propositions"])
    assert (known["budget"], known["versions"], known["machines"]) == ("smoke", [versions()], [machine()])
    reproduce.refuse_other_budgets([], [], "paper", str(tmp_path))
    with pytest.raises(UsageError, match="propositions was made with budget 'smoke', not 'paper'"):
        reproduce.refuse_other_budgets([], figures, "paper", str(tmp_path))


@pytest.mark.parametrize(
    ("changed", "told"),
    [
        ({"norm": None}, "it has no column norm"),
        ({"loss": None}, "it has no column loss"),
        ({"loss": "hl-laplace"}, "its loss has 'hl-laplace'; it must be one of 'gaussian'"),
        ({"reading": None}, "it has no column reading"),
        ({"task": 3}, "its task has 3"),
        ({"step": 1.5}, "its step are double; they must be int64"),
        ({"bound": "1"}, "its bound are string; they must be float"),
    ],
)
def test_samples_of_another_form_are_refused_by_the_column(tmp_path, changed, told):
    store = data_of(tmp_path)
    record = {"budget": "smoke", "versions": [{}], "machines": [""]}
    store.write("propositions.parquet", to_bytes(with_record(samples(**changed), record)))
    with pytest.raises(UsageError, match=f"propositions.parquet in .*{told}"):
        reproduce.load(str(tmp_path))


def test_a_summary_of_another_study_is_refused(tmp_path):
    summary = made_up.data(lambda *_: 1.0, ("lqr",)).sweeps["lqr"]
    other = dataclasses.replace(summary, study=dataclasses.replace(summary.study, trials=3))
    other.save(data_of(tmp_path), "lqr.parquet")
    with pytest.raises(UsageError, match="whose lqr is of another study than this version and budget 'smoke' ask for"):
        reproduce.train([MAIN["lqr"]], "smoke", str(tmp_path), lambda *_: None)


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        ({"budget": "huge"}, "its budget is 'huge'; it must be smoke or small or grid or paper"),
        ({"budget": 7}, "its record has budget 7; it must be str"),
        ({"versions": {"galton": "0"}}, "its record has versions {'galton': '0'}; it must be a list of dict"),
        ({"machines": [7]}, r"its record has machines \[7\]; it must be a list of str"),
        ({"train_seconds": "60"}, "its record has train_seconds '60'; it must be float"),
        ({"compile_seconds": float("nan")}, "its record has compile_seconds nan"),
    ],
)
def test_a_summary_that_does_not_say_how_it_was_made_is_refused(tmp_path, changes, said):
    summary = made_up.data(lambda *_: 1.0, ("lqr",)).sweeps["lqr"]
    dataclasses.replace(summary, provenance=summary.provenance | changes).save(data_of(tmp_path), "lqr.parquet")
    with pytest.raises(UsageError, match=f"lqr.parquet in .*{said}"):
        reproduce.load(str(tmp_path))


def test_figure_1_needs_no_training_and_takes_stale_figures_away(tmp_path, told):
    (tmp_path / "figures").mkdir()
    for name in ("figure-2.png", "mine.png"):
        (tmp_path / "figures" / name).touch()
    assert told("reproduce", "figure-1", "--out", tmp_path) == (0, "")
    there = sorted(path.name for path in (tmp_path / "figures").iterdir())
    assert there == ["figure-1.png", "figure-1.svg", "mine.png"]
    assert 'id="figure-1"' in (tmp_path / "index.html").read_text()


def test_a_summary_is_enough(tmp_path):
    """No sweep is carried out whose summary is there."""
    data = made_up.data(lambda *_: 1.0, ("bandit", "bandit-again"))
    for name, summary in data.sweeps.items():
        summary.save(data_of(tmp_path), f"{name}.parquet")

    def fail(*_):
        raise AssertionError("trained")

    reproduce.train([AGAIN["bandit"]], "smoke", str(tmp_path), fail)
    told: list[str] = []
    with pytest.raises(AssertionError, match="trained"):
        reproduce.train([AGAIN["bandit"], MAIN["lqr"]], "smoke", str(tmp_path), fail, told.append)
    assert told == ["3 of 3: lqr"]


MINE = """
from galton_experiments.analysis.plots import panels
from studies.paper.figure import FigureStudy
from studies.paper.gradients import Sample
from studies.paper.claims import CLAIMS
from studies.paper.registry import FIGURES
from studies.paper.verdicts import claim


def draw(trained):
    figure, (axes,) = panels(1)
    axes.plot([0, 1], gid="mine")
    return figure


def says(trained):
    return claim("of our own", "It is drawn.", "nothing", {})


FIGURES["mine"] = FigureStudy("A study of our own", "A line.", draw)
CLAIMS.append(("mine", says))
"""


def test_a_study_from_outside_stands_on_the_page(tmp_path):
    (tmp_path / "my_study.py").write_text(MINE)
    line = [sys.executable, "-m", "studies.paper", "reproduce", "mine", "--imports", "my_study"]
    path = {"PYTHONPATH": f"{tmp_path}{os.pathsep}{os.environ.get('PYTHONPATH', '')}"}
    done = subprocess.run(
        [*line, "--out", tmp_path / "out"], capture_output=True, text=True, timeout=300, cwd=ROOT, env=os.environ | path
    )
    assert done.returncode == 0, done.stderr
    page = (tmp_path / "out" / "index.html").read_text()
    assert 'id="mine"' in page
    assert page.index("a higher fraction of classification") < page.index("It is drawn.")
    assert (tmp_path / "out" / "figures" / "mine.svg").exists()


def test_a_sweep_from_outside_is_trained_drawn_and_judged(tmp_path, monkeypatch):
    """The grid whose winners are trained again on fresh seeds is loaded too, though the figure does not name it."""
    study = MAIN["lqr"].study("smoke", {})
    grid = Sweep("mine", lambda budget, done: study, title="My grid")
    mine = FigureStudy("My figure", "", lambda trained: Figure(), (again(grid),))
    monkeypatch.setattr(report, "CLAIMS", [*report.CLAIMS, ("my-figure", my_claim)])
    monkeypatch.setitem(FIGURES, "my-figure", mine)
    results = made_up.results(study, lambda setting: 1.0)
    Summary.of_results(study, results, made_up.PROVENANCE).save(data_of(tmp_path), "mine.parquet")
    trained = reproduce.load(str(tmp_path))
    assert [*trained.sweeps] == ["mine"]
    assert made.section(trained).table.rows[0][:3] == ["mine (My grid)", f"{len(study.settings)}", "2"]
    assert claims(trained)[-1].words == "Mine was trained."
    assert claims(trained)[-1].section == "my-figure"


def my_claim(trained):
    return claim("mine", "Mine was trained." if "mine" in trained.sweeps else "It was not.", "", {})


def data_of(folder):
    return reproduce.Store(f"{folder}/{reproduce.DATA}")


def test_data_of_no_figure_are_told(tmp_path):
    for name, summary in made_up.data(lambda *_: 1.0, ("lqr",)).sweeps.items():
        summary.save(data_of(tmp_path), f"{name}.parquet")
        summary.save(data_of(tmp_path), "strange.parquet")
    assert reproduce.of_no_figure(str(tmp_path)) == ["strange.parquet"]


@pytest.mark.parametrize("name", ["../x", "..", "/x", "", "a/b", "C:x", "a\0b", "..\\x"])
def test_figures_and_sweeps_of_ones_own_stay_in_the_folder(name, tmp_path, monkeypatch):
    with pytest.raises(UsageError, match="name is "):
        Sweep(name, lambda budget, done: None)
    out = tmp_path / "deep" / "paper"
    monkeypatch.setitem(FIGURES, name, FIGURES["figure-1"])
    monkeypatch.setattr(report, "figures", lambda _: {name: None})
    monkeypatch.setattr(report, "page", lambda *_: "")
    monkeypatch.setattr(report, "images", lambda _: {".png": b"drawn"})
    with contextlib.suppress(UsageError):  # figures/...png, of "..", is as good as any
        report.write(out, Trained({}, {}))
    assert {path for path in tmp_path.rglob("*") if not path.is_relative_to(tmp_path / "deep")} == set()
