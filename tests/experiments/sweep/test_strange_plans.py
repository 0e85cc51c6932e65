"""Plans with a right digest that no version of Galton wrote."""

import json

import numpy as np
import pyarrow as pa
import pytest

from galton.errors import NewerVersionError, UsageError
from galton_experiments.sweep import plan as plans
from galton_experiments.sweep.grid import expand
from galton_experiments.sweep.parquet import from_bytes, record_of, to_bytes
from galton_experiments.sweep.plan import FILE, Plan
from galton_experiments.sweep.store import Store
from galton_experiments.sweep.study import Study

from ...mutations import replaced

STUDY = Study("bandit", expand([{"n_bins": [5, 6], "n_steps": 5, "learning_rate": [0.1, 0.2]}], {}), 3, 60, 3, 2)
"""Two programs with two settings of three trials each."""


@pytest.fixture
def store(tmp_path):
    store = Store(str(tmp_path))
    Plan.create(STUDY, 4).save(store)
    return store


def put(store, table, record):
    digest = plans._digest(record, table)
    content = {b"galton": json.dumps({"plan": record, "digest": digest})}
    store.write(FILE, to_bytes(table.replace_schema_metadata(content)))


def of(name, values, kind=pa.int32()):  # noqa: B008
    return lambda table: replaced(table, name, pa.array(values, kind))


COLUMNS = {
    "shards from 1 on": (of("shard", [1] * 3 + [2] * 3 + [3] * 3 + [4] * 3), "must be numbered from 0 on"),
    "shards that fall": (of("shard", [0, 0, 0, 0, 1, 1, 0, 0, 2, 2, 3, 3]), "must be numbered from 0 on"),
    "a shard that is too wide": (of("shard", [0] * 6 + [1] * 6), "a shard of it has more than 4 runs"),
    "a shard of two programs": (of("shard", [0] * 4 + [1] * 4 + [2] * 4), "settings of several programs"),
    "a setting that is not there": (of("setting", [99] * 12), "its setting must be 0 to 3, as the study has 4"),
    "a trial less than 0": (of("trial", [-1, 1, 2] * 4), "its trial must be 0 to 2, as the study has 3"),
    "a run twice": (of("trial", [0, 0, 2] * 4), "each trial of each setting once, 12 runs"),
    "a run less": (lambda table: table.slice(0, 11), "each trial of each setting once, 12 runs"),
    "no runs": (lambda table: table.slice(0, 0), "each trial of each setting once, 12 runs"),
    "fractions": (of("setting", [0.5] * 12, pa.float64()), "its setting are double; they must be int32"),
    "seeds of another type": (of("seed", range(12), pa.int64()), "its seed are int64; they must be uint32"),
    "a trial that is missing": (of("trial", [None, 1, 2] * 4), "its trial are missing in 4 places"),
    "no seeds": (lambda table: table.drop_columns(["seed"]), "it has no column seed"),
    "trials twice": (lambda table: table.append_column("trial", table.column("trial")), "the column trial twice"),
}


@pytest.mark.parametrize(("make", "said"), COLUMNS.values(), ids=COLUMNS)
def test_other_runs_than_a_study_has_are_refused_by_name(store, make, said):
    table = from_bytes(store.read(FILE))
    put(store, make(table), record_of(table)["plan"])
    with pytest.raises(UsageError, match=rf"out is .*, whose plan.parquet is none of Galton's: .*{said}"):
        Plan.load(store)


def constants(**changes):
    return lambda record: record["constants"].update(changes)


RECORDS = {
    "no settings": (lambda record: record.pop("settings"), "KeyError: 'settings'"),
    "settings of another kind": (lambda record: record.update(settings=[]), "TypeError"),
    "no width": (lambda record: record.pop("shard_width"), "KeyError: 'shard_width'"),
    "a width of 0": (lambda record: record.update(shard_width=0), "shard_width is 0"),
    "a width that no memory holds": (lambda record: record.update(shard_width=10**9), "shard_width is 1,000,000,000"),
    "curves that no memory holds": (constants(steps=10**12, logs=10**10), "logs is 10,000,000,000"),
    "runs that 32 bits do not count": (constants(steps=10**10), "steps is 10,000,000,000; a run of a sweep may have"),
    "trials of text": (lambda record: record.update(trials="3"), "trials"),
    "imports of a number": (constants(imports=7), "TypeError"),
    "another field": (constants(extra=7), "which this version of Galton does not know"),
    "another setting": (
        lambda record: record["settings"]["same"].update(newer=1),
        "which this version of Galton does not know",
    ),
    "a list for the plan": (lambda record: record.clear(), "KeyError"),
}


@pytest.mark.parametrize(("change", "said"), RECORDS.values(), ids=RECORDS)
def test_another_record_is_refused_by_what_is_wrong_in_it(store, change, said):
    table = from_bytes(store.read(FILE))
    record = record_of(table)["plan"]
    change(record)
    put(store, table, record)
    with pytest.raises(UsageError, match=said) as told:
        Plan.load(store)
    assert str(told.value).startswith(f"out is {store.url}, whose plan.parquet ")
    assert isinstance(told.value, NewerVersionError) == (said == RECORDS["another field"][1])


def test_what_is_written_again_unchanged_is_read(store):
    table = from_bytes(store.read(FILE))
    put(store, table, record_of(table)["plan"])
    again = Plan.load(store)
    assert again.study == STUDY
    np.testing.assert_array_equal(again.seed, Plan.create(STUDY, 4).seed)


def test_no_plan_is_made_that_could_not_be_read():
    with pytest.raises(UsageError, match="shard_width is 100,001; it must be 100,000 at most"):
        Plan.create(STUDY, 100_001)
    with pytest.raises(UsageError, match="logs is 2,000,000; a curve may have 1,000,000 points at most"):
        Study("bandit", expand([{"n_steps": 1}], {}), 1, 10**7, 2 * 10**6)
    with pytest.raises(UsageError, match="trials is 5,000,001, which makes 10,000,002 runs"):
        Study("bandit", expand([{"eta": [0.5, 1]}], {}), 5_000_001, 10**7)
