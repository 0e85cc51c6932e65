"""`python docs/figures/changing.py` draws changing.png: five heads on two tasks that change, and how they come back."""

import json
from pathlib import Path

import numpy as np
from scipy import stats

from galton_experiments.analysis import plots

FOUND = json.loads((Path(__file__).parents[2] / "results" / "benchmarks" / "changing.json").read_text())
PANELS = {"jump": ("bandit whose optimum jumps", 1_000), "lqr": ("regulator whose inputs are reversed", 1_600)}
"""Titles, and the updates of a phase."""
LOOKS = {
    "centred HL-Gauss, diffusion": (plots.color(2), "-"),
    "Gaussian, floor": (plots.color(0), "-"),
    "Gaussian": (plots.color(0), ":"),
    "centred HL-Gauss": (plots.color(2), ":"),
    "HL-1-Hot": (plots.color(4), "--"),
}


def not_back(entry, updates):
    """The share of runs that are not back so many updates after the last change, Kaplan and Meier's estimate."""
    times = entry["updates_until_back"][-1]
    censored = [updates * 24 // 25] * (len(entry["scores"]) - len(times))
    return stats.ecdf(stats.CensoredData(times, right=censored)).sf


def main():
    """Draw the courses above the curves of recovery, and write the picture."""
    figure, axes = plots.panels(4, columns=2, width=4.3, height=2.5)
    for (task, (title, updates)), course, recovery in zip(PANELS.items(), axes[:2], axes[2:], strict=True):
        for head, (color, style) in LOOKS.items():
            look = {"color": color, "linestyle": style, "linewidth": 1.6, "label": head}
            curve = FOUND[head][task]["curve"]
            steps = np.arange(1, len(curve)) * 4 * updates / len(curve)
            course.plot(steps, curve[:-1], **look)
            left = not_back(FOUND[head][task], updates)
            ends = np.r_[0, left.quantiles, updates], np.r_[1, left.probabilities, left.probabilities[-1]]
            recovery.step(*ends, where="post", **look)
        for change in (1, 2, 3):
            course.axvline(change * updates, color="#bbbbbb", linewidth=0.8, zorder=0)
        course.set(title=title, xlabel="updates", ylim=(-1.05, 1.05), xlim=(0, 4 * updates))
        recovery.set(xlabel="updates since the last change", ylim=(-0.03, 1.03), xlim=(0, updates))
    axes[0].set_ylabel("share of the optimum")
    axes[2].set_ylabel("share of runs not back")
    plots.finish(figure, axes)
    plots.settle(figure)
    figure.savefig(Path(__file__).with_suffix(".png"), dpi=150)


if __name__ == "__main__":
    main()
