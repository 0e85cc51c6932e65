"""The study of tasks that change has every head, task and control, and its numbers agree with one another."""

import json
from pathlib import Path

import numpy as np
import pytest
from scipy import stats

ROOT = Path(__file__).parents[2]
FOUND = json.loads((ROOT / "results" / "benchmarks" / "changing.json").read_text())
TASKS = ("jump", "sine", "walk", "lqr")


@pytest.mark.parametrize("head", FOUND)
@pytest.mark.parametrize("task", TASKS)
def test_numbers_of_an_entry_agree_with_one_another(head, task):
    line = FOUND[head][task]
    assert len(line["tuned"]) == 12
    controls = [line["no change"], line["emptied"]] if task in ("jump", "lqr") else []
    for told in (line, *controls):
        assert len(told["scores"]) == len(told["regret"]) == 20
        assert np.shape(told["phases"]) == np.shape(told["entropy_before"]) == (4, 20)
        assert np.mean(told["curve"]) == pytest.approx(np.mean(told["scores"]), abs=1e-3)
        assert np.ptp(told["scores"]) > 0
        within = np.reshape(told["curve"], (4, 25))[:, :-1].mean(1)  # a log point at a change is in no phase
        np.testing.assert_allclose(np.mean(told["phases"], 1), within, atol=1e-3)


def test_a_task_that_stays_costs_less_regret_than_one_that_changes():
    for head, lines in FOUND.items():
        for task in ("jump", "lqr"):
            assert np.mean(lines[task]["no change"]["regret"]) < np.mean(lines[task]["regret"]), head


def last_recovery(head, task):
    """The updates from the last change until each run is back, or until the last look at those that are not."""
    times, updates = FOUND[head][task]["updates_until_back"][-1], {"jump": 1_000, "lqr": 1_600}[task]
    return stats.CensoredData(times, right=[updates * 24 // 25] * (20 - len(times)))


@pytest.mark.parametrize("head", FOUND)
def test_the_page_has_the_numbers_of_the_file(head):
    of = FOUND[head]
    columns = [*(of[task] for task in ("jump", "sine", "lqr")), of["lqr"]["no change"]]
    scores = [np.array(told["scores"]) for told in columns]
    spreads = [stats.t.ppf(0.975, 19) * stats.sem(one) for one in scores]
    cells = " | ".join(f"{one.mean():.3f} ± {spread:.3f}" for one, spread in zip(scores, spreads, strict=True))
    for task in ("jump", "lqr"):
        cells += f" | {of[task]['never_back'][-1]:.0%}"
        if head != "centred HL-Gauss, diffusion":
            p = stats.logrank(last_recovery("centred HL-Gauss, diffusion", task), last_recovery(head, task)).pvalue
            cells += " (<0.001)" if p < 0.001 else f" ({p:.2f})"
    cells = cells.replace("-", "−")
    label = head[0].upper() + head[1:].replace("floor", "floor under σ")
    assert f"| {label} | {cells} |" in (ROOT / "docs" / "changing_tasks.md").read_text().splitlines()


def test_what_the_page_says_beside_its_table():
    for of in FOUND.values():
        assert min(np.mean(of["walk"]["scores"]), np.mean(of["jump"]["no change"]["scores"])) > 0.96
    jump, lqr = ({head: of[task] for head, of in FOUND.items()} for task in ("jump", "lqr"))
    entropy = {head: np.mean(of["entropy_before"], 1) for head, of in jump.items()}
    assert (entropy["centred HL-Gauss, diffusion"].round(1) >= 6.4).all()
    np.testing.assert_allclose(entropy["HL-1-Hot"][:3], [0.2, 0.02, 0.04], atol=0.01)
    floor, diffused = (lqr[head] for head in ("Gaussian, floor", "centred HL-Gauss, diffusion"))
    for leader in (floor, diffused):
        first, *later = np.mean(leader["phases"], 1)
        assert first > max(later)
    assert diffused["never_back"] == jump["centred HL-Gauss, diffusion"]["never_back"] == [0, 0, 0]
    means = {head: [np.mean(of[task]["scores"]) for task in TASKS] for head, of in FOUND.items()}
    ahead = np.greater(means["centred HL-Gauss, diffusion"], means["Gaussian, floor"])
    assert ahead.tolist() == [True, True, True, False]
    emptied = {head: np.mean(of["emptied"]["scores"]) for head, of in jump.items()}
    np.testing.assert_allclose([means["HL-1-Hot"][0], emptied["HL-1-Hot"]], [0.33, 0.70], atol=0.005)
