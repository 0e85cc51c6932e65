"""Runs come back from their file as they were, and what is no summary is refused by name."""

import dataclasses
import json

import numpy as np
import pyarrow as pa
import pytest

from galton.errors import UsageError
from galton_experiments.runs import CURVES, Summary
from galton_experiments.sweep.grid import expand
from galton_experiments.sweep.parquet import from_bytes, record_of, to_bytes, with_record
from galton_experiments.sweep.results import best_settings
from galton_experiments.sweep.store import Store
from galton_experiments.sweep.study import Study

from ..mutations import MUTATIONS

BLOCKS = [{"loss": "gaussian"}, {"loss": "hl-gauss", "eta": [0.25, 0.75], "n_bins": 20}]
STUDY = Study("lqr", expand([block | {"learning_rate": [3e-4, 7e-4]} for block in BLOCKS], {}), 2, 400, 4, 1)
PROVENANCE = {"budget": "smoke", "train_seconds": 60}
N, L = len(STUDY.settings) * STUDY.trials, 6


@pytest.fixture
def table():
    """As `collect` makes it; the fourth run diverged."""
    ends = np.array([1000 * s["learning_rate"] + s["eta"] for s in STUDY.settings for _ in range(STUDY.trials)])
    curves = ends[:, None] * np.linspace(0, 1, L) + np.random.default_rng(0).uniform(0, 0.01, (N, L))
    gone = np.arange(N) == 3
    curves[gone] = np.nan
    lists = pa.FixedSizeListArray.from_arrays(curves.astype(np.float32).ravel(), L)
    steps = pa.array(np.tile(np.arange(1, L + 1, dtype=np.int32), N))
    keys = {"setting": np.arange(N) // STUDY.trials, "trial": np.arange(N) % STUDY.trials}
    keys |= {"diverged_at": np.where(gone, 1, -1)}
    final = dict.fromkeys(("final_training_return", "final_evaluation_return"), curves[:, -1].astype(np.float32))
    content = {name: of.astype(np.int32) for name, of in keys.items()} | final
    as_read = pa.list_(pa.field("element", pa.int32()), L)
    content |= {"steps": pa.FixedSizeListArray.from_arrays(steps, type=as_read)}
    return pa.table(content | dict.fromkeys((*CURVES, "sigma"), lists))


@pytest.fixture
def summary(table):
    return Summary.of_results(STUDY, table, PROVENANCE)


def test_a_summary_comes_back_from_its_file_the_same(summary, tmp_path):
    store = Store(str(tmp_path))
    summary.save(store, "one.parquet")
    again = Summary.load(store, "one.parquet")
    assert (again.study, again.provenance) == (STUDY, PROVENANCE)
    assert again.table.schema == summary.table.schema
    for name in summary.table.column_names:
        one, other = (np.array(each.table.column(name).to_pylist()) for each in (summary, again))
        np.testing.assert_array_equal(one, other)
    again.save(store, "two.parquet")
    assert store.read("one.parquet") == store.read("two.parquet")


def test_curves_keep_12_bits_and_final_numbers_all(summary, table):
    gone = np.array(table.column("diverged_at")) >= 0
    for metric in CURVES:
        exact = np.array(table.column(metric).to_pylist())
        np.testing.assert_allclose(summary.curves(metric)[~gone], exact[~gone], rtol=2**-13)
        assert np.isnan(summary.curves(metric)[gone]).all()
        assert np.isnan(summary.final(metric)[gone]).all()
    np.testing.assert_array_equal(summary.final("sigma")[~gone], exact[~gone, -1].astype(np.float32))


def test_the_best_setting_is_the_sweeps(summary, table):
    best, expected = summary.best, best_settings(STUDY, table)
    assert {loss: b.setting for loss, b in best.items()} == {loss: b.setting for loss, b in expected.items()}
    assert summary.rows(best["hl-gauss"].setting).sum() == STUDY.trials


def changed(summary, folder, make):
    """A folder where the summary's file has another content."""
    store = Store(str(folder))
    summary.save(store, "one.parquet")
    store.write("one.parquet", make(store.read("one.parquet")))
    return store


def of_record(change):
    """A file whose record has something else."""

    def make(data):
        record = record_of(from_bytes(data))
        change(record)
        return to_bytes(with_record(from_bytes(data), record))

    return make


def of_table(change):
    return lambda data: to_bytes(change(from_bytes(data)))


STRANGE = {
    "shorter": (lambda data: data[:-9], "no summary of a sweep, or was damaged: "),
    "empty": (lambda data: b"", "no summary of a sweep, or was damaged: "),
    "steps": (of_record(lambda r: r["study"]["constants"].update(steps=0)), "steps is 0; it must be an integer of at"),
    "newer": (of_record(lambda r: r["study"]["constants"].update(other=1)), "which this version of Galton does not"),
    "n_steps": (of_record(lambda r: r["study"]["settings"]["same"].update(n_steps=True)), "n_steps is True; it must"),
    "gamma": (of_record(lambda r: r["study"]["settings"]["same"].update(gamma="0.9")), "gamma is '0.9'; it must be"),
    "loss": (of_record(lambda r: r["study"]["settings"]["different"]["loss"].__setitem__(0, "mse")), "loss is 'mse'"),
    "column": (of_table(lambda t: t.append_column("x", t.column("setting"))), "a column x, which no summary has"),
    "twice": (of_table(lambda table: table.take([0, 0])), "it has one run twice"),
    "no runs": (of_table(lambda table: table.slice(0, 0)), "it has no runs"),
    "order": (of_table(lambda table: table.take([1, 0])), "its rows must be sorted by setting and trial"),
}


@pytest.mark.parametrize(("make", "said"), STRANGE.values(), ids=STRANGE)
def test_what_is_no_summary_is_refused_by_name(summary, tmp_path, make, said):
    with pytest.raises(UsageError, match=r"one\.parquet in .*") as told:
        Summary.load(changed(summary, tmp_path, make), "one.parquet")
    assert said in str(told.value)


@pytest.mark.parametrize("seed", range(120))
def test_a_changed_summary_is_refused_or_gives_the_right_numbers(summary, tmp_path, seed):
    draw, mutation = np.random.default_rng(seed), MUTATIONS[seed % len(MUTATIONS)]
    store = changed(summary, tmp_path, of_table(lambda table: mutation(table, draw)))
    try:
        found = Summary.load(store, "one.parquet")
    except UsageError as refusal:
        error = str(refusal)
    else:
        error = ""
    if error:
        assert "one.parquet in " in error
        return
    assert {*found.table.column_names} <= {*summary.table.column_names}  # what an earlier version did not keep
    for name in found.table.column_names:
        ours, theirs = (np.array(each.table.column(name).to_pylist()) for each in (found, summary))
        np.testing.assert_array_equal(ours, theirs)
    known = record_of(from_bytes(store.read("one.parquet")))
    assert json.loads(json.dumps(found.study.record())) == known["study"]  # if that is what a study can be
    assert found.best.keys() <= summary.best.keys()


def test_parts_and_runs_beside_one_another(summary, tmp_path):
    """Those of some settings, in their order, and as many trials of two sweeps as both have."""
    first, *others = STUDY.settings
    turned = summary.part([*others[::-1], first])
    assert turned.study.settings == (*others[::-1], first)
    for setting in STUDY.settings:
        ours, theirs = (each.final("sigma")[each.rows(setting)] for each in (turned, summary))
        np.testing.assert_array_equal(ours, theirs)
    turned.save(Store(str(tmp_path)), "turned.parquet")
    found = Summary.load(Store(str(tmp_path)), "turned.parquet")
    np.testing.assert_array_equal(found.final("sigma"), turned.final("sigma"))
    fewer = summary.part(others, trials=1)
    joined = summary.part([first]).joined(fewer)
    assert (joined.study.trials, joined.table.num_rows) == (1, len(STUDY.settings))
    assert not joined.study.common_seeds
    fresh = dataclasses.replace(summary, study=dataclasses.replace(STUDY, seed=1, common_seeds=True))
    assert fresh.is_paired_with(fresh)
    assert not fresh.is_paired_with(summary)
    assert fresh.part([first]).joined(fresh.part(others)).study.common_seeds
