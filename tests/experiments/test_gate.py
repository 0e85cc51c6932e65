"""Pages say of the gate what its file says."""

import importlib
import itertools
import json
import sys
from pathlib import Path

import numpy as np
import pytest

import galton

ROOT = Path(__file__).parents[2]
QUOTED = {
    "gaussian": 0.6,
    "truncated gaussian": 0.97,
    "discretised gaussian": 0.96,
    "centred × 4": 1.0,
    "spline": 1.0,
    "anchored, S = 1": 1.0,
}
TEXT = "the Gaussian .60, truncated .97, discretised .96; centred HL-Gauss, splines and the anchored softmax 1.00"


@pytest.fixture
def gate(monkeypatch):
    """benchmarks/gate.py, whose own loss and critic are known to nobody afterwards."""
    monkeypatch.syspath_prepend(ROOT / "benchmarks")
    registries = [(registry, dict(registry)) for registry in (galton.LOSSES, galton.CRITICS)]
    yield importlib.import_module("gate")
    del sys.modules["gate"]
    for registry, known in registries:
        registry.clear()
        registry.update(known)


def test_the_returns_with_two_peaks_are_those_of_the_file():
    assert TEXT in (ROOT / "docs" / "which_policy.md").read_text()
    lines = map(json.loads, (ROOT / "results" / "benchmarks" / "gate.jsonl").read_text().splitlines())
    of = {(line["anchor"], line["head"]): line["returns"] for line in lines if line["task"] == "two-peaks"}
    for head, said in QUOTED.items():
        both = [np.mean(of[anchor, head]) for anchor in ("sb3", "hand-set")]
        assert np.mean(both) == pytest.approx(said, abs=0.005), head


HEADS = {
    "Truncated Gaussian": "truncated gaussian",
    "Discretised Gaussian": "discretised gaussian",
    "Anchored softmax": "anchored, S = 1",
    "Spline": "spline",
    "Centred HL-Gauss, head rate per σ": "centred, rate per σ",
}
FOUR = ("HalfCheetah-v5", "Hopper-v5", "Reacher-v5", "Swimmer-v5")


@pytest.mark.slow
def test_the_chances_on_four_tasks_are_those_of_the_file(gate):
    done = gate.read(ROOT / "results" / "benchmarks" / "gate.jsonl")
    text = (ROOT / "docs" / "winner.md").read_text()
    lines = gate.tables({key: line for key, line in done.items() if key[0] in FOUR})
    rows = [row.strip("| ").split(" | ") for row in lines]
    above = {(row[0], row[1]): row[-1] for row in rows if len(row) == 7 and row[2] == str(len(FOUR))}
    for label, head in HEADS.items():
        told = [above.get((anchor, head), "—") for anchor in ("sb3", "hand-set")]
        assert f"| {label} | {told[0]} | {told[1]} |" in text
    earned = [
        np.mean(done["mountain-car", anchor, head]["returns"])
        for anchor, head in itertools.product(("hand-set", "sb3"), ("gaussian", *[*HEADS.values()][:2]))
    ]
    assert np.round(np.abs(earned)).tolist() == [0, 0, 0, 94, 38, 19]


CRITICS = {
    "the squared error with their range and start": "gaussian, standardised critic",
    "`two-hot`": "gaussian, two-hot critic",
    "`hl-gauss`": "gaussian, hl-gauss critic",
}


def test_the_chances_of_critics_are_those_of_the_file(gate):
    lines = gate.tables(gate.read(ROOT / "results" / "benchmarks" / "gate_critics.jsonl"))
    rows = [row.strip("| ").split(" | ") for row in lines]
    above = {(row[0], row[1]): row[-1] for row in rows if len(row) == 7 and row[2] == "3"}
    text = (ROOT / "docs" / "parts.md").read_text()
    for label, head in CRITICS.items():
        assert f"| {label} | {above['sb3', head]} | {above['hand-set', head]} |" in text
