"""The page about actions says of the benchmark of choices what its file says."""

import re
from pathlib import Path

ROOT = Path(__file__).parents[2]


def test_the_rows_are_those_of_the_file(monkeypatch):
    monkeypatch.syspath_prepend(ROOT / "benchmarks")
    import choices

    rows = set(choices.tables(choices.read(ROOT / "results" / "benchmarks" / "choices.jsonl")))
    told = re.findall(
        r"^\| (?:bandit|cartpole|lunar-lander|picker) \|.*$", (ROOT / "docs" / "actions.md").read_text(), re.M
    )
    assert len(told) >= 6
    assert set(told) <= rows
