import numpy as np
import pytest

from galton.errors import UsageError
from galton.paper.summary import CURVES, Summary
from galton.sweep.results import best_settings
from galton.sweep.store import Store

from .made_up import PROVENANCE, SWEEPS, results

STUDY = SWEEPS["lqr"].study("smoke", {})


def final_of(setting):
    return setting.hypers.learning_rate * 1000 + setting.hypers.eta


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
