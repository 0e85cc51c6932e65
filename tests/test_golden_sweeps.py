"""Sweeps and results of earlier versions mean what they meant: tests/golden/README.md."""

import shutil

import numpy as np
import pyarrow.parquet as pq
import pytest

from galton_experiments.sweep.grid import paper_grid, task_defaults
from galton_experiments.sweep.plan import Plan, fold_in
from galton_experiments.sweep.store import Store
from galton_experiments.sweep.study import Study

# All that is not public; where it lives may change, what is read with it may not.
from .golden.files import CLOSE, V1, command, record


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


@pytest.mark.slow
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


@pytest.mark.parametrize("env", record("names.json"))
def test_settings_runs_and_shards_of_the_papers_grid_keep_their_names_and_seeds(env):
    known, settings = record("names.json")[env], paper_grid(env, task_defaults(env))
    names = [setting.name for setting in settings]
    assert names == known["settings"]
    for study, seeds in known["seeds"].items():
        assert [[fold_in(int(study), name, trial) for trial in range(3)] for name in names] == seeds
    assert Plan.create(Study(env, settings, 3, 1000)).names == known["shards"]
