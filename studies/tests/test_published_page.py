"""The published page and its tables are what `report` makes of the published data."""

import shutil
from pathlib import Path

import pytest

from galton_experiments.page import quotes
from studies.paper import report, reproduce

ROOT = Path(__file__).parents[2]
RESULTS = ROOT / "results" / "paper"


@pytest.mark.optimised
def test_page_tables_and_figures_are_made_of_the_data_to_the_byte(tmp_path):
    shutil.copytree(RESULTS / "data", tmp_path / "data")
    report.write(tmp_path, reproduce.load(str(tmp_path)))
    for name in ("index.html", report.FILE):
        assert (tmp_path / name).read_bytes() == (RESULTS / name).read_bytes(), (
            f"python -m studies.paper report {RESULTS}"
        )
    of_both = [sorted(path.name for path in (folder / "figures").iterdir()) for folder in (tmp_path, RESULTS)]
    assert of_both[0] == of_both[1]


def test_tables_of_results_are_quoted_as_they_were_made():
    known = report.tables(reproduce.load(str(RESULTS)))
    for path in (ROOT / "docs" / "reproduce.md", ROOT / "docs" / "why.md"):
        text = path.read_text()
        assert "<!-- table: " in text
        assert quotes.filled(text, known.get) == text, f"python -m studies.paper tables {RESULTS} {path}"
