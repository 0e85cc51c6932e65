"""The page on V-MPO says what the file of the benchmark of trust regions has."""

import json
from pathlib import Path

import numpy as np
import pytest
from scipy import stats

ROOT = Path(__file__).parents[2]
FOUND = json.loads((ROOT / "results" / "benchmarks" / "trust_regions.json").read_text())


SMALL = {"lqr": ".2f", "acrobot": ".1f"}
ROBOTS = ("HalfCheetah-v5", "Walker2d-v5")
PAGE = (ROOT / "docs" / "v-mpo.md").read_text().splitlines()


def told(returns, form):
    spread = stats.t.ppf(0.975, len(returns) - 1) * stats.sem(returns)
    return f"{np.mean(returns):{form}} ± {spread:{form}}".replace("-", "−")


@pytest.mark.parametrize("loss", ["least squares", "HL-1-Hot", "HL-Gauss", "centred HL-Gauss"])
def test_a_row_is_that_of_the_file(loss):
    of_loss = [FOUND[f"{algorithm}, {loss}"] for algorithm in ("PPO", "TRPO", "V-MPO")]
    for lines in of_loss:
        assert all(len(lines[task]["tuned"]) == 8 and len(lines[task]["returns"]) == 10 for task in SMALL)
        assert f"{np.mean(lines['bandit']['returns']):.1f}" == "24.9"
    cells = [told(lines[task]["returns"], form) for task, form in SMALL.items() for lines in of_loss]
    assert f"| {loss} | {' | '.join(cells)} |" in PAGE


@pytest.mark.parametrize("method", [method for method, lines in FOUND.items() if ROBOTS[0] in lines])
def test_a_row_of_robots_is_that_of_the_file(method):
    lines = [FOUND[method][robot] for robot in ROBOTS]
    assert all((len(line["tuned"]), len(line["returns"])) == (8, 5) for line in lines)
    cells = [told(line["returns"], ",.0f") for line in lines]
    assert f"| {method} | {' | '.join(cells)} |" in PAGE


def test_no_update_leaves_its_bound():
    for lines in FOUND.values():
        for line in lines.values():
            assert line["kl"] is None or max(line["kl"]) < 1


def apart(one, other):
    """The difference of two methods' means on a task, and its 95% interval."""
    test = stats.ttest_ind(one["returns"], other["returns"], equal_var=False)
    return [np.mean(one["returns"]) - np.mean(other["returns"]), *test.confidence_interval()], test.pvalue


def test_what_the_page_says_beside_its_tables():
    for algorithm, expected in (("TRPO", [0.43, 0.89]), ("V-MPO", [0.08, 0.86])):
        used = [np.mean(lines["lqr"]["kl"]) for name, lines in FOUND.items() if name.startswith(algorithm)]
        np.testing.assert_allclose([min(used), max(used)], expected, atol=0.005)
    gain, _ = apart(FOUND["V-MPO, HL-Gauss"]["lqr"], FOUND["PPO, HL-Gauss"]["lqr"])
    np.testing.assert_allclose(gain, [7.3, 5.6, 9.0], atol=0.051)
    for task, pairs, expected, atol in (("lqr", 6, [3.3, 1.9, 4.8], 0.051), (ROBOTS[1], 3, [-591, -969, -213], 0.51)):
        found, p = apart(FOUND["V-MPO, least squares"][task], FOUND["V-MPO, HL-1-Hot"][task])
        np.testing.assert_allclose(found, expected, atol=atol)
        assert p * pairs < 0.05
    for robot in ROBOTS:
        assert all(
            np.mean(FOUND[f"V-MPO, {loss}"][robot]["returns"]) < np.mean(FOUND["TRPO, least squares"][robot]["returns"])
            for loss in ("least squares", "HL-1-Hot", "HL-Gauss")
        )
