"""The page about PyTorch says of its benchmarks what their files say."""

import json
import re
import statistics
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
PAGE = (ROOT / "docs" / "in_pytorch.md").read_text()
RESULTS = ROOT / "results" / "benchmarks"


@pytest.fixture(autouse=True)
def benchmarks(monkeypatch):
    monkeypatch.syspath_prepend(ROOT / "benchmarks")


def test_the_returns_are_those_of_the_file():
    import in_torch

    rows = set(in_torch.table(in_torch.read(RESULTS / "in_torch.jsonl")))
    told = re.findall(r"^\| (?:SB3|rsl_rl|Galton), .*$", PAGE, re.M)
    assert len(told) == 9
    assert set(told) <= rows


def test_an_update_costs_what_the_file_says():
    taken = json.loads((RESULTS / "in_torch_cost.json").read_text())
    base, centred, one_hot = (
        statistics.median(taken[method]) for method in ("SB3, Gaussian", "SB3, hl-gauss-centred", "SB3, hl-one-hot")
    )
    assert f"{centred / base:.2f} times as long with centred HL-Gauss and {one_hot / base:.2f} with HL-1-Hot as" in PAGE


def test_what_many_epochs_do_is_that_of_the_file():
    import many_epochs

    rows = set(many_epochs.table(many_epochs.read(RESULTS / "many_epochs.jsonl")))
    told = re.findall(r"^\| (?:Gaussian|one-hot|η = ).*$", PAGE, re.M)
    assert len(told) >= 6
    assert set(told) <= rows
