"""The page on V-MPO says what the file of the benchmark of trust regions has."""

import itertools
import json
from pathlib import Path

import numpy as np
import pytest
from scipy import stats

ROOT = Path(__file__).parents[2]
FOUND = json.loads((ROOT / "results" / "benchmarks" / "trust_regions.json").read_text())


ROBOTS = ("HalfCheetah-v5", "Walker2d-v5")
PAGE = (ROOT / "docs" / "v-mpo.md").read_text().splitlines()


def told(returns, form):
    spread = stats.t.ppf(0.975, len(returns) - 1) * stats.sem(returns)
    return f"{np.mean(returns):{form}} ± {spread:{form}}".replace("-", "−")


@pytest.mark.parametrize("method", [method for method, lines in FOUND.items() if "lqr" in lines])
def test_a_row_is_that_of_the_file(method):
    lines = [FOUND[method][task] for task in ("bandit", "lqr", "acrobot")]
    assert all((len(line["tuned"]), len(line["returns"])) == (8, 10) for line in lines)
    kl = lines[1]["kl"]
    cells = [*(told(line["returns"], ".2f") for line in lines[:2]), told(lines[2]["returns"], ".1f")]
    assert f"| {method} | {' | '.join(cells)} | {f'{np.mean(kl):.2f}' if kl else '—'} |" in PAGE


@pytest.mark.parametrize("method", [method for method, lines in FOUND.items() if ROBOTS[0] in lines])
def test_a_row_of_robots_is_that_of_the_file(method):
    lines = [FOUND[method][robot] for robot in ROBOTS]
    assert all((len(line["tuned"]), len(line["returns"])) == (8, 5) for line in lines)
    cells = [told(line["returns"], ",.0f") for line in lines]
    assert any(line.startswith(f"| {method} | {' | '.join(cells)} |") for line in PAGE)


def test_no_update_leaves_its_bound():
    for lines in FOUND.values():
        for line in lines.values():
            assert line["kl"] is None or max(line["kl"]) <= 1.1  # a Gaussian's mean and σ have a bound each


def test_what_the_page_says_beside_its_table():
    lqr = {method: np.array(lines["lqr"]["returns"]) for method, lines in FOUND.items()}
    gain = stats.ttest_ind(lqr["V-MPO, HL-Gauss"], lqr["PPO, HL-Gauss"], equal_var=False).confidence_interval()
    np.testing.assert_allclose([gain.low, gain.high], [5.7, 9.1], atol=0.05)
    of_vmpo = {method: returns for method, returns in lqr.items() if method.startswith("V-MPO")}
    clear = {}
    for one, other in itertools.combinations(of_vmpo, 2):
        test = stats.ttest_ind(of_vmpo[one], of_vmpo[other], equal_var=False)
        if test.pvalue * 6 < 0.05:  # of six pairs
            clear[one, other] = [*test.confidence_interval()]
    assert [*clear] == [("V-MPO, least squares", "V-MPO, HL-1-Hot")]
    np.testing.assert_allclose(*clear.values(), [0.9, 3.5], atol=0.05)
    over = [np.mean(FOUND[method]["lqr"]["kl"]) for method in of_vmpo]
    assert 1.2 < max(over) < 1.25
    assert max(np.mean(FOUND[method]["bandit"]["kl"]) for method in of_vmpo) == pytest.approx(1.9, abs=0.05)
