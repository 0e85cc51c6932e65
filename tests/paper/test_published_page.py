"""The published page and its tables are what `galton report` makes of the published data."""

import shutil
from pathlib import Path

import pytest

from galton.cli import report
from galton.paper import tables

RESULTS = Path(__file__).parents[2] / "results" / "paper"


@pytest.mark.slow
def test_page_tables_and_figures_are_made_of_the_data_to_the_byte(tmp_path):
    shutil.copytree(RESULTS / "data", tmp_path / "data")
    report.main([str(tmp_path)])
    for name in ("index.html", tables.FILE):
        assert (tmp_path / name).read_bytes() == (RESULTS / name).read_bytes(), f"galton report {RESULTS}"
    of_both = [sorted(path.name for path in (folder / "figures").iterdir()) for folder in (tmp_path, RESULTS)]
    assert of_both[0] == of_both[1]
