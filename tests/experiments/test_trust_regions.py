"""The page on V-MPO says what the file of the benchmark of trust regions has."""

import itertools
import json
from pathlib import Path

import numpy as np
import pytest
from scipy import stats

ROOT = Path(__file__).parents[2]
FOUND = json.loads((ROOT / "results" / "benchmarks" / "trust_regions.json").read_text())


@pytest.mark.parametrize("method", FOUND)
def test_a_row_is_that_of_the_file(method):
    cells = []
    for line in FOUND[method].values():
        assert (len(line["tuned"]), len(line["returns"])) == (8, 10)
        spread = stats.t.ppf(0.975, 9) * stats.sem(line["returns"])
        cells.append(f"{np.mean(line['returns']):.2f} ± {spread:.2f}".replace("-", "−"))
    kl = FOUND[method]["lqr"]["kl"]
    cells.append(f"{np.mean(kl):.2f}" if kl else "—")
    assert f"| {method} | {' | '.join(cells)} |" in (ROOT / "docs" / "v-mpo.md").read_text().splitlines()


def test_trpo_never_leaves_its_bound():
    for method, lines in FOUND.items():
        for line in lines.values():
            assert not method.startswith("TRPO") or max(line["kl"]) < 1


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
