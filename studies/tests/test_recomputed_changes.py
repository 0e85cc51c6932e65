"""The second path on sweeps that nobody trained: every change, runs that diverged, pairs and none."""

import zlib

import pyarrow as pa
import pytest

from galton_experiments.runs import Summary
from galton_experiments.sweep.store import Store
from studies.paper import hypotheses
from studies.paper.returns import ends_higher
from studies.paper.trained import Trained

from . import made_up
from .recomputed.changes import cell, rows, table
from .recomputed.runs import read_all


def by_chance(name, setting):
    """Return where a setting's runs end: anywhere, by its name."""
    return zlib.crc32(f"{name} {setting.name}".encode()) % 1000 / 100


def saved(trained, folder):
    """The sweeps as files, and as the second path reads them."""
    for name, summary in trained.sweeps.items():
        summary.save(Store(str(folder)), f"{name}.parquet")
    return read_all(folder)


@pytest.fixture(scope="module")
def made():
    return made_up.judgeable(by_chance, noise=3.0, trials=9)


def test_every_change_is_judged_alike(made, tmp_path):
    sweeps = saved(made, tmp_path)
    found = {name: [cell(judged) for judged in row] for name, row in table(sweeps).items()}
    shown = hypotheses.table(made).rows
    assert {name: [(each.text, each.verdict) for each in cells[1:]] for name, cells in shown.items()} == found
    assert {*rows(sweeps)} == {*shown}
    assert len({verdict for row in found.values() for _, verdict in row} - {None}) == 4


def judged(trained):
    """The marks of one claim in every row of the table."""
    claims = {name: ends_higher(under) for name, under in hypotheses.rows(trained) if under.judged}
    return {name: [line[0] for line in claim.number.splitlines()] for name, claim in claims.items()}


@pytest.fixture(scope="module")
def before(made):
    return judged(made)


@pytest.mark.parametrize(
    ("file", "ahead", "turns"),
    [
        ("hypotheses-lqr-again", 1, {"c", "e", "f", "g"}),
        ("hypotheses-lqr-r-0.1-again", -1, {"d"}),
        ("scale-lqr-8", 1, {"b"}),
        ("boxed-bandit-again", 1, {"a"}),
        ("reacher-without-lowest-rate", 1, {"h"}),
    ],
)
def test_a_gaussian_far_ahead_or_behind_under_a_change_turns_its_rows_alone(file, ahead, turns, made, before):
    """Those of the letters of the changes that the file holds, and to the contrary of the paper where it is ahead."""
    study, table = made.sweeps[file].study, made.sweeps[file].table
    gaussian = made.sweeps[file].rows(*(setting for setting in study.settings if setting["loss"] == "gaussian"))
    finals = pa.array((made.sweeps[file].final("training_return") + ahead * 1e6 * gaussian).astype("float32"))
    place = table.column_names.index("final_training_return")
    changed = Summary(study, {}, table.set_column(place, "final_training_return", finals))
    after = judged(Trained({**made.sweeps, file: changed}))
    differ = {name for name in before if before[name] != after[name]}
    assert differ
    assert {name[1] for name in differ} <= turns
    assert all(after[name].count("✗") * ahead >= before[name].count("✗") * ahead for name in differ)
