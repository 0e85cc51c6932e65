"""Results of earlier versions mean what they meant: tests/golden/README.md."""

import hashlib
from pathlib import Path

import numpy as np

from studies.paper import reproduce
from studies.paper.registry import all_sweeps
from studies.paper.sweeps import AGAIN, MAIN, unpaired
from tests.golden.files import V1, record

PAPER = Path(__file__).parents[2] / "results" / "paper"


def told_by(trained):
    """Return what a folder of `reproduce` says; what that proves of the paper is for each version to judge."""
    found = {}
    for name, summary in trained.sweeps.items():
        names = [setting.name for setting in summary.study.settings]
        best = {loss: [one.setting.name, *map(mean, one[1:3])] for loss, one in summary.best.items()}
        digest = hashlib.sha256("\n".join(names).encode()).hexdigest()
        found[name] = {"runs": summary.table.num_rows, "settings": len(names), "names": digest, "best": best}
    return found


def mean(runs):
    return float(runs.mean())


def test_results_say_what_they_said():
    assert told_by(reproduce.load(str(V1 / "results"))) == record("results.json")["sweeps"]


def test_results_are_still_of_the_studies_that_reproduce_asks_for():
    def carry_out(store, plan):
        raise AssertionError(f"{store.url} is trained again")

    reproduce.train([MAIN["bandit"], AGAIN["bandit"]], "smoke", str(V1 / "results"), carry_out)
    assert [path.name for path in (V1 / "results").iterdir()] == ["data"]


def test_all_published_results_are_of_the_studies_that_reproduce_asks_for(trained):
    """To the letter: a folder that has them trains none of them again."""
    for name, sweep in all_sweeps().items():
        there = trained.sweeps[name].study
        study = sweep.study(trained.sweeps[name].provenance["budget"], trained.sweeps)
        assert there in (study, unpaired(study, there.trials) if study.common_seeds else study), name


def test_all_published_results_open(trained):
    assert set(record("paper.json")["sweeps"]) <= set(trained.sweeps) <= set(all_sweeps())
    files = {path.stem for path in (PAPER / "data").iterdir()}
    assert files == set(trained.sweeps) | {"propositions"}
    assert trained.tables["propositions"].num_rows > 0
    for summary in trained.sweeps.values():
        assert summary.table.num_rows == len(summary.study.settings) * summary.study.trials
        assert np.isfinite(summary.curves("evaluation_return")).any()


def test_published_results_say_what_they_said(trained):
    known = record("paper.json")
    files = {path.name: hashlib.sha256(path.read_bytes()).hexdigest() for path in (PAPER / "data").iterdir()}
    unchanged = {name for name in known["sweeps"] if files[f"{name}.parquet"] == known["files"][f"{name}.parquet"]}
    assert unchanged, "all of results/paper was measured again; write tests/golden anew beside the old version"
    told = told_by(trained)
    assert {name: told[name] for name in unchanged} == {name: known["sweeps"][name] for name in unchanged}
