"""galton plot: the learning curves of runs."""

import dataclasses
from collections.abc import Sequence
from pathlib import Path
from typing import Annotated

import numpy as np
import tyro

from galton.cli._reading import read_options
from galton.cli._runs import STEP, points
from galton.errors import require
from galton.saving import files
from galton.saving.result_folder import METRICS
from galton_experiments.analysis.plots import color, dashes, draw_series, finish, fit, images, over_steps, panels
from galton_experiments.analysis.statistics import Interval

SHOWN = {"rollout/ep_rew_mean": "training return", "eval/mean_reward": "evaluation return, deterministic policy"}
"""The metrics of a log that are drawn, with their titles."""


@dataclasses.dataclass(frozen=True)
class Options:
    """Draw the training and evaluation returns of runs over their steps."""

    runs: Annotated[tuple[Path, ...], tyro.conf.Positional, tyro.conf.arg(metavar="RUN ...")]
    """Run folders of `galton train`."""
    out: Path = Path("curves.png")
    """The figure, a .png or .svg."""


def main(arguments: Sequence[str]) -> None:
    """Read the runs' logs and write the figure."""
    options = read_options(Options, "plot", arguments)
    require(options.out.suffix in (".png", ".svg"), f"out is {options.out}; its name must end in .png or .svg")
    require(len(options.runs) > 0, "runs is empty; name a run folder of `galton train`, or several")
    logs = {str(run): points(run / METRICS) for run in options.runs}
    for run, log in logs.items():
        require(
            bool(log), f"run is {run}, which holds no {METRICS} with log points; name a run folder of `galton train`"
        )
    known = [name for name in SHOWN if any(name in point for log in logs.values() for point in log)]
    told = f"runs is {', '.join(logs)}, where no episode has ended yet, so there is no return to draw; train for longer"
    require(len(known) > 0, told)
    figure, axes = panels(len(known), height=3.7, width=4.55)
    for panel, metric in zip(axes, known, strict=True):
        means, last = [], 0.0
        for i, (run, log) in enumerate(logs.items()):
            steps, values = (
                np.array([(point[STEP], point[metric]) for point in log if metric in point]).reshape(-1, 2).T
            )
            shown = f"./{run}" if run.startswith("_") else run  # matplotlib hides labels that begin so
            mark = "o" if len(steps) == 1 else ""
            draw_series(panel, steps, Interval(values, values, values), shown, color(i), dashes(i), mark)
            means.append(values)
            last = max(last, *(point[STEP] for point in log))
        panel.set_title(SHOWN[metric], fontsize=10)
        over_steps(panel, last)
        fit(panel, means)
    finish(figure, axes)
    with files.named("out", options.out):
        files.write(options.out, images(figure)[options.out.suffix])
    print(f"figure: {options.out}")
