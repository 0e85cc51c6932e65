"""Either path reads once what is published in results/paper."""

import pytest

from studies.paper import reproduce

from .recomputed.runs import DATA, TITLES, sweep_of, tables_in


@pytest.fixture(scope="session")
def trained():
    """As the page is made of it."""
    found = reproduce.load(str(DATA.parent))
    assert {*found.judged} == {*TITLES}
    return found


@pytest.fixture(scope="session")
def tables():
    """As the files have it."""
    return tables_in()


@pytest.fixture(scope="session")
def sweeps(tables):
    """As the second path reads it."""
    return {name: sweep_of(table) for name, table in tables.items()}
