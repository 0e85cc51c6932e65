"""Results of earlier versions mean what they meant: tests/golden/README.md."""

import hashlib
from pathlib import Path

import numpy as np

from studies.paper import reproduce
from studies.paper.registry import all_sweeps
from studies.paper.sweeps import AGAIN, MAIN
from tests.golden.files import V1, record

PAPER = Path(__file__).parents[2] / "results" / "paper"


def told_by(out):
    """What a folder of `reproduce` says; what that proves of the paper is for each version to judge."""
    found = {}
    for name, summary in reproduce.load(str(out)).sweeps.items():
        names = [setting.name for setting in summary.study.settings]
        best = {
            loss: [
                one.setting.name,
                *(float(x.mean()) for x in (one.final_training_return, one.final_evaluation_return)),
            ]
            for loss, one in summary.best.items()
        }
        digest = hashlib.sha256("\n".join(names).encode()).hexdigest()
        found[name] = {"runs": summary.table.num_rows, "settings": len(names), "names": digest, "best": best}
    return found


def test_results_say_what_they_said():
    assert told_by(V1 / "results") == record("results.json")["sweeps"]


def test_results_are_still_of_the_studies_that_reproduce_asks_for():
    def carry_out(store, plan):
        raise AssertionError(f"{store.url} is trained again")

    reproduce.train([MAIN["bandit"], AGAIN["bandit"]], "smoke", str(V1 / "results"), carry_out)
    assert [path.name for path in (V1 / "results").iterdir()] == ["data"]


def test_all_published_results_open():
    data = reproduce.load(str(PAPER))
    assert set(record("paper.json")["sweeps"]) <= set(data.sweeps) <= set(all_sweeps())
    files = {path.stem for path in (PAPER / "data").iterdir()}
    assert files == set(data.sweeps) | {"propositions"}
    assert data.tables["propositions"].num_rows > 0
    for summary in data.sweeps.values():
        assert summary.table.num_rows == len(summary.study.settings) * summary.study.trials
        assert np.isfinite(summary.curves("evaluation_return")).any()


def test_published_results_say_what_they_said():
    known = record("paper.json")
    files = {path.name: hashlib.sha256(path.read_bytes()).hexdigest() for path in (PAPER / "data").iterdir()}
    unchanged = {name for name in known["sweeps"] if files[f"{name}.parquet"] == known["files"][f"{name}.parquet"]}
    assert unchanged, "all of results/paper was measured again; write tests/golden anew beside the old version"
    told = told_by(PAPER)
    assert {name: told[name] for name in unchanged} == {name: known["sweeps"][name] for name in unchanged}
