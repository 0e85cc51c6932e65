"""The page's table of what the text says has the numbers of the benchmark's file, and its verdicts follow from them."""

import json
from pathlib import Path

import numpy as np
from scipy import stats

from galton.envs.lqr import LQR
from galton_experiments.analysis import Interval, compare, mean_interval

ROOT = Path(__file__).parents[2]
FOUND = json.loads((ROOT / "results" / "benchmarks" / "text_claims.json").read_text())
PAGE = (ROOT / "docs" / "paper.md").read_text().partition("## What the text says beside")[2].partition("\n## ")[0]
BINS = (3, 5, 7, 11, 25)
CHEETAH = "HalfCheetah-v5"
LOSSES = ("gaussian", "hl-one-hot")
CASES = [case for case in FOUND["bounds"] if "gaussian" not in case]


def runs(study, entry, score="training", row=0):
    return np.array(FOUND[study][entry][score][row], float)


def uniform(case, score="training"):
    """What sampling uniformly in the bin adds to the center's return."""
    how = (runs("sampling", f"{case}, {name}", score) for name in ("uniform", "center"))
    return compare(*how, paired=True)


def exponential(case):
    """What the exponential weight adds with its best temperature."""
    rows = (runs("exponential", f"{case}, exp", row=i) for i in range(3))
    return compare(max(rows, key=np.mean), runs("exponential", f"{case}, A"), paired=True)


def failed(kind):
    """The runs that end below −40, of how many, and the interval of their share."""
    scores = runs("normalised", kind)
    n = int((scores < -40).sum())
    low, high = stats.binomtest(n, len(scores)).proportion_ci()
    return f"{n} ({100 * low:.0f} to {100 * high:.0f}%)"


def times(case, name):
    """How many times the Gaussian's a loss's number is in the same setting: a ratio of geometric means."""
    setting = case.split(",")[0]
    ours, theirs = (np.log(FOUND["bounds"][each][name]) for each in (case, f"{setting}, gaussian"))
    return Interval(*np.exp(compare(ours, theirs).difference))


def crossed(explores, learns):
    return np.array(FOUND["crossed"][f"{explores} explores"][learns]["training"][0])


def across(name):
    ratios = [times(case, name).mean for case in CASES]
    return f"{min(ratios):.1f} to {max(ratios):.1f}"


def listed(values):
    return ", ".join(values)


def test_the_exponential_weight_is_clearly_worse_but_for_hl_gauss_on_the_lqr():
    case = "bandit, hl-one-hot", "lqr, hl-one-hot", "bandit, hl-gauss", "lqr, hl-gauss"
    found = [exponential(each) for each in case]
    assert [each.direction for each in found] == [-1, -1, -1, 1]
    assert max(each.p for each in found) < 0.05
    one_hot = f"bandit {found[0].difference:+.2f}, LQR {found[1].difference:+.1f}."
    assert f"{one_hot} HL-Gauss: bandit {found[2].difference:+.2f}, LQR (η = 0.25) {found[3].difference:+.0f} |" in PAGE


def test_uniform_actions_in_a_bin_cost_where_bins_are_coarse_and_gain_nothing():
    bandit, lqr = ([uniform(f"{task}, hl-one-hot, {k}") for k in (5, 10, 25)] for task in ("bandit", "lqr"))
    assert bandit[0].difference.high < 0
    assert lqr[0].difference.high < 0
    for task in ("bandit", "lqr"):
        assert all(uniform(f"{task}, hl-one-hot, {k}", "mode").p > 0.05 for k in (5, 10, 25))
    told = listed(f"{each.difference:+.2f}" for each in bandit)
    assert f"{told}. LQR: {listed(f'{each.difference:+.1f}' for each in lqr)} |" in PAGE


def test_as_many_runs_of_the_gaussian_fail_as_told():
    assert f"{failed('clipped')} clipped, {failed('normalised')} normalised, {failed('normalised apart')} with" in PAGE


def test_the_bounds_of_classification_are_the_larger_ones_and_hold():
    assert sum(of["above"] for of in FOUND["bounds"].values()) == 0
    for case in CASES:
        assert min(times(case, name).low for name in ("bound", "bound_printed", "sd_bound")) > 1, case
    told = f"the bound is {across('bound')} times the Gaussian's, its deviation {across('sd_bound')} times, the norm"
    assert f"{told} {across('norm')} times |" in PAGE
    for setting in ("usual", "selected", "normalised"):  # with σ = 1 both readings are one
        of = FOUND["bounds"][f"{setting}, gaussian"]
        np.testing.assert_allclose(of["bound"], of["bound_printed"], rtol=0.1)


def test_more_bins_are_better_on_the_lqr():
    means = [runs("coarse", f"lqr, {k}", "mode").mean() for k in BINS]
    assert means == sorted(means)
    assert means[-1] < LQR().optimal_return
    assert compare(runs("coarse", "lqr, 3", "mode"), runs("coarse", "lqr, 25", "mode")).difference.high < 0
    told = listed(f"{mean_interval(runs('coarse', f'lqr, {k}', 'mode')):.1f}" for k in BINS)
    cheetah = listed(f"{mean_interval(runs('coarse', f'{CHEETAH}, {k}', 'mode')):,.0f}" for k in BINS)
    assert f"LQR: {told}. HalfCheetah: {cheetah} |" in PAGE


def test_who_learns_from_the_same_data_on_the_lqr():
    cells = []
    for explores in LOSSES:
        one_hot, gaussian = crossed(explores, "hl-one-hot"), crossed(explores, "gaussian")
        assert compare(one_hot, gaussian, paired=True).difference.low > 0
        assert one_hot.mean() < -26.03
        cells += [f"{mean_interval(one_hot):.0f}", f"{mean_interval(gaussian):.0f}"]
    assert f"HL-1-Hot {cells[0]}, a Gaussian {cells[1]}; on a softmax's: {cells[2]}, {cells[3]} |" in PAGE


def test_the_conditions_of_the_bandit_on_the_lqr():
    plain = runs("exponential", "lqr, hl-one-hot, A")
    gaussian, init = (runs("crossed", name) for name in ("Gaussian Exploration", "Init Gaussian"))
    assert compare(gaussian, plain, paired=True).difference.high < 0
    assert compare(init, plain, paired=True).p > 0.05
    told = [f"{mean_interval(each):.1f}" for each in (gaussian, init, plain)]
    assert f"{told[0]} and {told[1]}, without {told[2]} |" in PAGE
