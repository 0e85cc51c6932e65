"""The second path on sweeps that nobody trained: every change, runs that diverged, pairs and none."""

import zlib

import pytest

from galton.paper import hypotheses
from galton.sweep.store import Store

from . import made_up
from .recomputed.changes import cell, rows, table
from .recomputed.runs import read_all


def by_chance(name, setting):
    """Where a setting's runs end: anywhere, by its name."""
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
    assert {row.name for row in hypotheses.rows(made) if row.trained.judged} == {*rows(sweeps)} == {*shown}
    assert len({verdict for row in found.values() for _, verdict in row} - {None}) == 4
