"""Pages say of the gate what its file says."""

import json
from pathlib import Path

import numpy as np
import pytest

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


def test_the_returns_with_two_peaks_are_those_of_the_file():
    assert TEXT in (ROOT / "docs" / "which_policy.md").read_text()
    lines = map(json.loads, (ROOT / "results" / "benchmarks" / "gate.jsonl").read_text().splitlines())
    of = {(line["anchor"], line["head"]): line["returns"] for line in lines if line["task"] == "two-peaks"}
    for head, said in QUOTED.items():
        both = [np.mean(of[anchor, head]) for anchor in ("sb3", "hand-set")]
        assert np.mean(both) == pytest.approx(said, abs=0.005), head
