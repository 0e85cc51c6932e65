"""The page's table of what the text says has the numbers of the benchmark's file, and its verdicts follow from them."""

import json
from pathlib import Path

import numpy as np
import pytest
from scipy import stats

from galton.envs.lqr import LQR
from galton_experiments.analysis import Interval, compare, mean_interval

ROOT = Path(__file__).parents[2]
FOUND = json.loads((ROOT / "results" / "benchmarks" / "text_claims.json").read_text())
PAGE = (ROOT / "docs" / "paper.md").read_text()
BINS = (3, 5, 7, 11, 25)
CHEETAH = "HalfCheetah-v5"
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


def rows():
    one_hot = [uniform(f"bandit, hl-one-hot, {k}") for k in (5, 10, 25)]
    lqr = [uniform(f"lqr, hl-one-hot, {k}") for k in (5, 10, 25)]
    yield listed(f"{each.difference:+.2f}" for each in one_hot)
    yield listed(f"{each.difference:+.1f}" for each in lqr)
    for case, spec in {"bandit, hl-one-hot": ".2f", "lqr, hl-one-hot": ".1f", "bandit, hl-gauss": ".2f"}.items():
        yield f"{exponential(case).difference:+{spec}}"
    yield f"{exponential('lqr, hl-gauss').difference:+.0f}"
    yield f"{failed('clipped')} clipped, {failed('normalised')} normalised, {failed('normalised apart')} with actor"
    yield f"the bound is {across('bound')} times the Gaussian's, the norm {across('norm')} times"
    yield listed(f"{mean_interval(runs('coarse', f'lqr, {k}', 'mode')):.1f}" for k in BINS)
    yield listed(f"{mean_interval(runs('coarse', f'{CHEETAH}, {k}', 'mode')):,.0f}" for k in BINS)
    for explores in ("gaussian", "hl-one-hot"):
        one_hot, gaussian = (mean_interval(crossed(explores, learns)) for learns in ("hl-one-hot", "gaussian"))
        yield f"{one_hot:.0f} beside {gaussian:.0f}"
    for name in ("Gaussian Exploration", "Init Gaussian"):
        yield f"{mean_interval(runs('crossed', name)):.1f}"
    yield f"{mean_interval(runs('exponential', 'lqr, hl-one-hot, A')):.1f}"


if __name__ == "__main__":
    print("\n".join(rows()))
