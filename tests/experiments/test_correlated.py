"""The file of the benchmark of correlated actions keeps to what no policy can exceed."""

import json
from pathlib import Path

import numpy as np
import pytest

from galton.envs import RidgeBandit, XorBandit

FOUND = json.loads((Path(__file__).parents[2] / "results" / "benchmarks" / "correlated.json").read_text())


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
