"""Sweeps and results of earlier versions mean what they meant: tests/golden/README.md."""

import hashlib
import shutil
from pathlib import Path

import numpy as np
import pyarrow.parquet as pq
import pytest

# All that is not public; where it lives may change, what is read with it may not.
from galton.paper import reproduce
from galton.paper.registry import all_sweeps
from galton.paper.sweeps import AGAIN, MAIN
from galton.sweep.grid import paper_grid, task_defaults
from galton.sweep.plan import Plan, fold_in
from galton.sweep.store import Store
from galton.sweep.study import Study

from .golden.files import CLOSE, V1, command, record

PAPER = Path(__file__).parents[1] / "results" / "paper"


@pytest.fixture
def sweep(tmp_path):
    """The sweep that lacks a shard, beside its grid."""
    shutil.copytree(V1 / "sweep", tmp_path / "sweep")
    shutil.copy(V1 / "grid.toml", tmp_path)
    return tmp_path / "sweep"


def rows(folder):
    """Of results.parquet, by setting and trial."""
    table = pq.ParquetFile(folder / "results.parquet").read(use_threads=False)
    columns = {name: np.array(table.column(name).to_pylist()) for name in table.column_names}
    keys = zip(columns["setting"].tolist(), columns["trial"].tolist(), strict=True)
    return {key: {name: values[i] for name, values in columns.items()} for i, key in enumerate(keys)}


def check_rows(found, golden):
    for key, row in golden.items():
        assert row.keys() <= found[key].keys()
        for name, value in row.items():
            if value.dtype.kind == "f":
                np.testing.assert_allclose(found[key][name], value, **CLOSE, err_msg=name)
            else:
                np.testing.assert_array_equal(found[key][name], value, err_msg=name)


def test_a_plan_keeps_its_names_and_seeds(sweep):
    plan, known = Plan.load(Store(str(sweep))), record("sweep.json")
    assert [setting.name for setting in plan.study.settings] == known["settings"]
    assert plan.names == known["shards"]
    for column in ("setting", "trial", "seed"):
        assert getattr(plan, column).tolist() == known[column]


def test_finished_shards_count_and_the_missing_one_alone_is_trained(sweep):
    known, golden = record("sweep.json"), rows(sweep)
    before = {path.name: (path.read_bytes(), path.stat().st_mtime_ns) for path in (sweep / "shards").iterdir()}
    assert len(before) == len(known["shards"]) - 1

    command("sweep", "results", str(sweep), cwd=sweep.parent)
    there = rows(sweep)
    assert len(there) == 10
    check_rows(there, {key: golden[key] for key in there})

    command(*known["command"], "--workers", "1", "--out", "sweep", cwd=sweep.parent)
    after = {path.name: (path.read_bytes(), path.stat().st_mtime_ns) for path in (sweep / "shards").iterdir()}
    assert before.items() <= after.items()
    (new,) = after.keys() - before.keys()
    missing = known["missing"]
    assert new.startswith(f"{missing:07d}-{known['shards'][missing]}-")
    assert rows(sweep).keys() == golden.keys()
    check_rows(rows(sweep), golden)


def told_by(out):
    """What a folder of `galton reproduce` says; what that proves of the paper is for each version to judge."""
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


@pytest.mark.parametrize("env", record("names.json"))
def test_settings_runs_and_shards_of_the_papers_grid_keep_their_names_and_seeds(env):
    known, settings = record("names.json")[env], paper_grid(env, task_defaults(env))
    names = [setting.name for setting in settings]
    assert names == known["settings"]
    for study, seeds in known["seeds"].items():
        assert [[fold_in(int(study), name, trial) for trial in range(3)] for name in names] == seeds
    assert Plan.create(Study(env, settings, 3, 1000)).names == known["shards"]
