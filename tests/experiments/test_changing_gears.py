"""The study of a robot whose gears are reversed tells on its page what its file has."""

import json
from pathlib import Path

import numpy as np
import pytest
from scipy import stats

ROOT = Path(__file__).parents[2]
FOUND = json.loads((ROOT / "results" / "benchmarks" / "changing_gears.json").read_text())
PAGE = (ROOT / "docs" / "changing_tasks.md").read_text()
HEADS = {"Gaussian": "Gaussian", "centred HL-Gauss": "Centred HL-Gauss", "discretised Gaussian": "Discretised Gaussian"}


def inside(entry):
    """The returns `[3, 4, 11]` of each seed and phase; the last log point of a phase is behind a change."""
    return np.reshape(entry["returns"], (3, 4, 12))[..., :-1]


def updates_until_back(entry):
    """Of each seed and change until the return is 500, or 44, the last look before the next change."""
    back = inside(entry)[:, 1:] >= 500
    return 4 * np.where(back.any(-1), back.argmax(-1) + 1, 11)


def interval(values, digits=0):
    return f"{np.mean(values):,.{digits}f} ± {stats.t.ppf(0.975, len(values) - 1) * stats.sem(values):,.{digits}f}"


def later(entry):
    """Of each seed the mean return after the first change, and the mean of its updates until it was back."""
    return inside(entry)[:, 1:].mean((1, 2)), updates_until_back(entry).mean(1)


@pytest.mark.parametrize("head", FOUND)
def test_entries_agree_with_their_returns(head):
    for entry in [*FOUND[head]["reversed"].values(), *FOUND[head].get("stays", {}).values()]:
        assert entry["diverged"] == 0
        np.testing.assert_allclose(np.transpose(entry["phases"]), inside(entry).mean(-1), atol=0.11)
        is_back, times = (inside(entry)[:, 1:] >= 500).any(-1), updates_until_back(entry)
        for change in range(3):
            back = is_back[:, change]
            assert sorted(entry["updates_until_back"][change]) == sorted(times[back, change])
            assert entry["never_back"][change] == 3 - back.sum()


@pytest.mark.parametrize("head", FOUND)
def test_the_page_has_the_numbers_of_the_file(head):
    (seen, until), (of_window, sooner) = (later(FOUND[head]["reversed"][way]) for way in ("all", "window"))
    stays = interval(later(FOUND[head]["stays"]["all"])[0]) if "stays" in FOUND[head] else "—"
    returns = f"{interval(seen)} | {interval(of_window)} | {stays}"
    assert f"| {HEADS[head]} | {returns} | {interval(until, 1)} | {interval(sooner, 1)} |" in PAGE.splitlines()


def test_the_page_tells_what_a_window_adds():
    pairs = [np.subtract(*(later(of["reversed"][way]) for way in ("window", "all"))) for of in FOUND.values()]
    returns, updates = np.concatenate(pairs, 1)
    told = f"Over the {len(returns)} pairs of runs a window adds {interval(returns)} to the return and "
    assert (told + f"{interval(updates, 1)} updates.").replace("-", "−") in PAGE
