"""`python docs/figures/draws.py` draws draws.png: Gaussian and bins with the same numbers, a dot for each draw."""

import json
from pathlib import Path

import numpy as np
import pyarrow.parquet as pq

from galton_experiments.analysis import plots

RESULTS = Path(__file__).parents[2] / "results"
TASKS = {"half-cheetah": "HalfCheetah", "hopper": "Hopper", "reacher": "Reacher"}
METHODS = ("gaussian", "edges")


def returns(task):
    """The mean returns `[2, draws]` of both methods on a tuning task of benchmarks/winner-mujoco.toml."""
    runs = pq.read_table(RESULTS / "winner-mujoco" / "data" / f"tuning-{task}.parquet")
    means = runs.group_by(["method", "draw"]).aggregate([("final_judged", "mean")])
    found = {(row["method"], row["draw"]): row["final_judged_mean"] for row in means.to_pylist()}
    draws = sorted({draw for _, draw in found})
    return np.array([[found[method, draw] for draw in draws] for method in METHODS])


def selected():
    """The draw whose numbers were selected for all tasks: one and the same for both methods."""
    of = json.loads((RESULTS / "winner-mujoco" / "report.json").read_text())["selected"]["shared"]
    (draw,) = {of[method] for method in METHODS}
    return draw


def main():
    """Draw a panel for each task and write the picture."""
    figure, axes = plots.panels(len(TASKS), columns=3, width=3.1, height=3.1)
    for panel, (task, label) in zip(axes, TASKS.items(), strict=True):
        gaussian, head = returns(task)
        ends = [min(gaussian.min(), head.min()), max(gaussian.max(), head.max())]
        room = 0.06 * (ends[1] - ends[0])
        limits = (ends[0] - room, ends[1] + room)
        panel.plot(limits, limits, color="#777777", lw=1, ls="--")
        panel.plot(gaussian, head, "o", color=plots.color(0), ms=6, clip_on=False)
        panel.plot(gaussian[selected()], head[selected()], "o", mfc="none", mec="#D55E00", mew=2, ms=14)
        ahead = int((head > gaussian).sum())
        panel.text(0.05, 0.93, f"bins higher: {ahead} of {len(head)}", transform=panel.transAxes, va="top")
        panel.set(title=label, xlim=limits, ylim=limits, xlabel="return of the Gaussian", aspect="equal")
    axes[0].set_ylabel("return of bins, same numbers")
    plots.settle(figure)
    figure.savefig(Path(__file__).with_suffix(".png"), dpi=200)


if __name__ == "__main__":
    main()
