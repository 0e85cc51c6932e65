import dataclasses
import json

import numpy as np
import pytest

from galton.errors import UsageError
from galton_experiments.runs import CURVES, Summary
from galton_experiments.sweep.parquet import from_bytes, record_of, to_bytes, with_record
from galton_experiments.sweep.results import best_settings
from galton_experiments.sweep.store import Store
from studies.paper import reproduce
from tests.mutations import MUTATIONS

from .made_up import PROVENANCE, SWEEPS, results

STUDY = SWEEPS["lqr"].study("smoke", {})


def final_of(setting):
    return setting["learning_rate"] * 1000 + setting["eta"]


@pytest.fixture
def table():
    return results(STUDY, final_of, diverged=(3,))


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
    for metric in CURVES:
        exact = np.array(table.column(metric).to_pylist())
        gone = np.array(table.column("diverged_at")) >= 0
        np.testing.assert_allclose(summary.curves(metric)[~gone], exact[~gone], rtol=2**-13)
        assert np.isnan(summary.curves(metric)[gone]).all()
        assert np.isnan(summary.final(metric)[gone]).all()
    np.testing.assert_array_equal(summary.final("sigma")[~gone], exact[~gone, -1].astype(np.float32))


def test_the_best_setting_is_the_sweeps(summary, table):
    best, expected = summary.best, best_settings(STUDY, table)
    assert {loss: b.setting for loss, b in best.items()} == {loss: b.setting for loss, b in expected.items()}
    assert summary.rows(best["hl-gauss"].setting).sum() == STUDY.trials


@pytest.mark.parametrize(
    "damage", [lambda data: data[:-9], lambda data: b"", lambda data: data.replace(b"PAR1", b"PAR2")]
)
def test_a_damaged_file_is_named(summary, tmp_path, damage):
    store = Store(str(tmp_path))
    summary.save(store, "one.parquet")
    store.write("one.parquet", damage(store.read("one.parquet")))
    with pytest.raises(UsageError, match=r"one.parquet in .* no summary"):
        Summary.load(store, "one.parquet")


def changed(summary, folder, make):
    """A folder of a reproduction whose file of the LQR's sweep has another content."""
    store = Store(f"{folder}/{reproduce.DATA}")
    summary.save(store, "lqr.parquet")
    store.write("lqr.parquet", to_bytes(make(from_bytes(store.read("lqr.parquet")))))
    return str(folder)


def provenance(**changes):
    """Other words on how it was made; a field that is None is left out."""

    def make(table):
        record = record_of(table)
        told = record["provenance"] | changes
        return with_record(table, record | {"provenance": {k: v for k, v in told.items() if v is not None}})

    return make


def constants(**changes):
    def make(table):
        record = record_of(table)
        record["study"]["constants"] |= changes
        return with_record(table, record)

    return make


def fields(**changes):
    def make(table):
        record = record_of(table)
        record["study"]["settings"]["same"] |= changes
        return with_record(table, record)

    return make


def another_loss(table):
    record = record_of(table)
    record["study"]["settings"]["different"]["loss"][0] = "mse"
    return with_record(table, record)


@pytest.mark.parametrize(
    ("make", "said"),
    [
        (provenance(budget="huge"), "its budget is 'huge'; it must be smoke or small or grid or paper"),
        (provenance(budget=7), "its record has budget 7; it must be str"),
        (provenance(budget=None), "its record has no budget"),
        (provenance(versions={"galton": "0"}), "its record has versions {'galton': '0'}; it must be a list of dict"),
        (provenance(machines=[7]), "its record has machines [7]; it must be a list of str"),
        (provenance(train_seconds="60"), "its record has train_seconds '60'; it must be float"),
        (provenance(compile_seconds=float("nan")), "its record has compile_seconds nan"),
        (constants(steps=0), "steps is 0; it must be an integer of at least 1"),
        (constants(trials_of_another="x"), "which this version of Galton does not know"),
        (fields(n_steps=True), "n_steps is True; it must be an integer of at least 1"),
        (fields(gamma="0.9"), "gamma is '0.9'; it must be a number"),
        (fields(bin_sample="middle"), "middle"),
        (another_loss, "loss is 'mse'"),
        (lambda table: table.append_column("x", table.column("setting")), "a column x, which no summary has"),
        (lambda table: table.take([0, 0]), "it has one run twice"),
        (lambda table: table.slice(0, 0), "it has no runs"),
    ],
)
def test_a_whole_file_that_is_no_summary_is_refused_by_name(summary, tmp_path, make, said):
    with pytest.raises(UsageError) as told:
        reproduce.load(changed(summary, tmp_path, make))
    for word in ("lqr.parquet in ", said):
        assert word in str(told.value)


@pytest.mark.parametrize("seed", range(120))
def test_a_changed_summary_is_refused_or_gives_the_right_numbers(summary, tmp_path, seed):
    draw, mutation = np.random.default_rng(seed), MUTATIONS[seed % len(MUTATIONS)]
    error = None
    try:
        found = reproduce.load(changed(summary, tmp_path, lambda table: mutation(table, draw))).sweeps["lqr"]
    except UsageError as refusal:
        error = refusal
    if error:
        assert "lqr.parquet in " in str(error)
        return
    assert {*found.table.column_names} <= {*summary.table.column_names}  # what an earlier version did not keep
    for name in found.table.column_names:
        ours, theirs = (np.array(each.table.column(name).to_pylist()) for each in (found, summary))
        np.testing.assert_array_equal(ours, theirs)
    known = record_of(from_bytes(Store(f"{tmp_path}/{reproduce.DATA}").read("lqr.parquet")))
    assert (
        json.loads(json.dumps(found.study.record())) == known["study"]
    )  # what it says of itself, if that is what a study can be
    assert found.best.keys() <= summary.best.keys()


def test_rows_in_another_order_are_refused_since_pairs_go_by_their_places(summary, tmp_path):
    store, rows = Store(str(tmp_path)), np.arange(summary.table.num_rows)
    rows[[0, 1]] = rows[[1, 0]]
    dataclasses.replace(summary, table=summary.table.take(rows)).save(store, "one.parquet")
    with pytest.raises(UsageError, match="its rows must be sorted by setting and trial"):
        Summary.load(store, "one.parquet")
