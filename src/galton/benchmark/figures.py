"""The figures of a benchmark's page."""

from collections.abc import Callable

import numpy as np
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from galton.analysis.plots import color, draw_marks, draw_series, finish, label_rows, over_steps, panels
from galton.analysis.scales import fit_curves
from galton.analysis.statistics import Interval, mean_interval
from galton.benchmark import tables
from galton.benchmark.found import Found
from galton.benchmark.stages import Role, Stage

_SERIES: dict[tuple[Stage, Role], tuple[str, str, str]] = {
    ("fresh", "shared"): ("tuning tasks, one setting for all", "o", "#0072B2"),
    ("fresh", "per-task"): ("tuning tasks, a setting for each", "s", "#56B4E9"),
    ("held-out", "shared"): ("held-out tasks, the same one setting", "D", "#D55E00"),
}
"""Name, mark and colour of what has a score."""


def scores(found: Found) -> Figure:
    """Interquartile means of normalised scores with their intervals, by method; by both returns."""
    standings = found.standings
    there = [(stage, role) for stage, role in _SERIES if stage in standings]
    figure, axes = panels(2 if there else 0, width=max(3.1, 0.9 * len(found.protocol.methods)), height=3.1)
    labels = [method.label for method in found.protocol.methods]
    for panel, curve, title in zip(
        axes, ("judged", "training"), (tables.metric(found), "training return"), strict=False
    ):
        for i, (stage, role) in enumerate(there):
            of_method = standings[stage].scores
            marks = [getattr(of_method[method.name][role], curve) for method in found.protocol.methods]
            name, mark, shade = _SERIES[stage, role]
            draw_marks(panel, marks, name, shade, (i - (len(there) - 1) / 2) * 0.16, mark)
        panel.set_title(title, fontsize=10)
        panel.set_xticks(range(len(labels)), labels, rotation=20, ha="right")
        panel.set_xlim(-0.5, len(labels) - 0.5)
    label_rows(axes, "interquartile mean of percentiles")
    finish(figure, axes)
    return figure


def best_of(found: Found) -> Figure:
    """What tuning with n draws gets, for one setting and for one for each task."""
    figure, axes = panels(2, height=3.1, width=3.9)
    kinds = {"shared": "one setting for all tuning tasks", "per_task": "a setting for each tuning task"}
    for panel, (kind, title) in zip(axes, kinds.items(), strict=True):
        for i, method in enumerate(found.protocol.methods):
            got = getattr(found.best_of[method.name], kind)
            draw_series(
                panel, np.arange(1, len(got) + 1), Interval(got, got, got), method.label, color(i), _line(i), "o"
            )
        panel.set_title(title, fontsize=10)
        panel.set_xlabel("draws")
        panel.xaxis.set_major_locator(MaxNLocator(integer=True))
    label_rows(axes, "mean percentile of the best")
    finish(figure, axes)
    return figure


def curves(found: Found) -> Figure:
    """What runs are judged by over environment steps, of the shared settings on each task, on fresh seeds."""
    stages = [runs for of_stage in found.later.values() for runs in of_stage]
    figure, axes = panels(len(stages), columns=3)
    for panel, runs in zip(axes, stages, strict=True):
        drawn = []
        for i, method in enumerate(found.protocol.methods):
            steps, of_runs = runs.curves(method.name, "shared")
            drawn.append(mean_interval(of_runs))
            draw_series(panel, steps, drawn[-1], method.label, color(i), _line(i), single_runs=of_runs)
        fit_curves(panel, drawn)
        held_out = " (held out)" if runs.stage == "held-out" else ""
        panel.set_title(f"{runs.part.task.label}{held_out}", fontsize=10)
        over_steps(panel, float(runs.part.steps))
    label_rows(axes, tables.metric(found))
    finish(figure, axes)
    return figure


def _line(i: int) -> str:
    """The line style of the i-th method, where colours repeat."""
    return "-" if i < 8 else "--"


FIGURES: dict[str, Callable[[Found], Figure]] = {"scores": scores, "curves": curves, "best-of-n": best_of}
"""The figures by name; one without axes is left out."""
