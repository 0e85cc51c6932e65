"""The benchmark of the drifting bandit: what its file has, and its order."""

import json
from pathlib import Path

import numpy as np

ROOT = Path(__file__).parents[2]
FOUND = json.loads((ROOT / "results" / "benchmarks" / "drifting.json").read_text())


def test_no_run_of_plain_hl_gauss_is_back_after_the_last_jump():
    assert FOUND["HL-Gauss, η .75"]["jump"]["never_back"][-1] == 1.0


def test_the_order_is_that_of_an_independent_simulation():
    """Heads with more than .1 between them in numpy (a review of 2026-11-26, other seeds) stand in its order here."""
    simulated = {
        "centred HL-Gauss, diffusion 1": 0.944,
        "Gaussian, σ ≥ .2": 0.906,
        "Gaussian, σ ≥ .1": 0.851,
        "Gaussian, entropy bonus .03": 0.842,
        "Gaussian": 0.524,
        "centred HL-Gauss": 0.330,
        "HL-1-Hot": -0.089,
    }
    here = {name: np.mean(FOUND[name]["jump"]["returns"]) for name in simulated}
    for one, ahead in simulated.items():
        for other, behind in simulated.items():
            assert ahead - behind < 0.1 or here[one] > here[other]
