"""What is published fits the file that it was trained by, and documents quote it as it is."""

import json
from pathlib import Path

import pytest

from galton.benchmark import quoted
from galton.benchmark.folder import FILE
from galton.benchmark.reading import read
from galton.page import quotes

ROOT = Path(__file__).parents[2]
PUBLISHED = sorted(path.parent.name for path in (ROOT / "results").glob(f"*/{FILE}"))


def test_something_is_published():
    assert "winner-a2c" in PUBLISHED


@pytest.mark.parametrize("name", PUBLISHED)
def test_results_have_the_hash_of_the_committed_file_and_documents_its_numbers(name):
    file, folder = ROOT / "benchmarks" / f"{name}.toml", ROOT / "results" / name
    assert json.loads((folder / FILE).read_text())["benchmark"] == read(file).digest
    known = quoted.tables(file, str(folder))
    told = 0
    for path in (ROOT / "README.md", *(ROOT / "docs").rglob("*.md")):
        text = path.read_text()
        told += f"<!-- table: {name}: " in text
        assert quotes.filled(text, known) == text, f"python -m galton.benchmark.quoted {file} {folder} {path}"
    assert told
