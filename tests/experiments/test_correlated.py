"""The file of the benchmark of correlated actions keeps to what no policy can exceed."""

import json
from pathlib import Path

import numpy as np
import pytest
from scipy import stats

from galton.envs import RidgeBandit, XorBandit

ROOT = Path(__file__).parents[2]
FOUND = json.loads((ROOT / "results" / "benchmarks" / "correlated.json").read_text())
HEADS = {"gaussian": "Gaussian", "full-gaussian": "full Gaussian"} | {
    f"{policy}, {loss}": f"{label}, {name}"
    for policy, label in {"histogram": "softmax", "joint": "joint softmax", "autoregressive": "autoregressive"}.items()
    for loss, name in {"hl-one-hot": "HL-1-Hot", "hl-gauss-centred": "centred HL-Gauss"}.items()
}


def test_bounds_are_those_of_the_tasks():
    xor, ridge = XorBandit(), RidgeBandit(across=16.0)
    for name, expected in (
        ("xor-bandit", (xor.soft_optimum(0.25, 10), xor.factored_optimum(0.25, 10))),
        ("ridge-bandit", (ridge.soft_optimum(0.1), ridge.factored_optimum(0.1))),
    ):
        assert (FOUND[name]["optimum"], FOUND[name]["factored"]) == pytest.approx(expected)


@pytest.mark.parametrize("name", ["xor-bandit", "ridge-bandit"])
def test_factored_heads_stay_below_their_bound_and_only_correlated_ones_pass_it(name):
    of = FOUND[name]
    for head, values in of["values"].items():
        factored = head.startswith(("gaussian", "histogram"))
        assert max(values) < of["factored" if factored else "optimum"] + 1e-3
        assert factored or np.mean(values) > of["factored"]


def test_on_a_robot_no_gain_is_clear():
    of = {head: returns["deterministic"] for head, returns in FOUND["HalfCheetah-v5"].items()}
    for more, less, expected in (
        ("autoregressive, hl-one-hot", "histogram, hl-one-hot", "−131 [−708, 446]"),
        ("full-gaussian", "gaussian", "1,071 [−858, 3,000]"),
    ):
        low, high = stats.ttest_ind(of[more], of[less], equal_var=False).confidence_interval()
        told = f"{np.mean(of[more]) - np.mean(of[less]):,.0f} [{low:,.0f}, {high:,.0f}]".replace("-", "−")
        assert low < 0 < high
        assert told == expected
        assert told in (ROOT / "docs" / "correlated_actions.md").read_text()


@pytest.mark.parametrize("head", HEADS)
def test_the_page_has_the_numbers_of_the_file(head):
    cells = []
    for name in ("xor-bandit", "ridge-bandit"):
        values = FOUND[name]["values"].get(head)
        spread = values and stats.t.ppf(0.975, len(values) - 1) * stats.sem(values)
        cells.append(f"{np.mean(values):.3f} ± {spread:.3f}".replace("-", "−") if values else "—")
    row = f"| {HEADS[head]} | {' | '.join(cells)} |"
    assert row in (ROOT / "docs" / "correlated_actions.md").read_text().splitlines()
