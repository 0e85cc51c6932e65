"""Learning curves of each loss's best setting, and what panels of a task share."""

from collections.abc import Mapping

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from galton.analysis.plots import draw_level, draw_series, finish, fit, look_of, over_steps, panels
from galton.analysis.statistics import mean_interval
from galton.paper.scale import optimum
from galton.paper.summary import Summary
from galton.tasks import TASKS


def heading(task: str) -> str:
    """For a panel, as in the paper: with the action's dimensionality."""
    return f"{TASKS[task].title} (d = {TASKS[task].d})"


def draw_best(axes: Axes, best_of: Mapping[str, Summary], metric: str, task: str) -> None:
    """Mean and 95% CI of each loss's best setting (App. C.2), from the sweep that it is the best of."""
    means: list[np.ndarray | np.float64] = []
    for loss, summary in best_of.items():
        runs = summary.curves(metric)[summary.rows(summary.best[loss].setting)]
        interval = mean_interval(runs)
        label, color, line = look_of(loss)
        draw_series(axes, summary.steps, interval, label, color, line, single_runs=runs)
        over_steps(axes, float(summary.steps[-1]))
        means.append(interval.mean)
    fit(axes, [*means, *draw_levels(axes, task)])


def draw_levels(axes: Axes, task: str) -> list[np.ndarray]:
    """The best that any policy can do, and what the action 0 earns: those that are known."""
    levels = [(optimum(task), "optimum", "--"), (TASKS[task].at_rest, "doing nothing", ":")]
    known = [(value, name, line) for value, name, line in levels if value is not None]
    for level in known:
        draw_level(axes, *level)
    return [np.array([value]) for value, *_ in known]


def best_curves(grids: Mapping[str, Summary], metric: str) -> Figure:
    """The learning curves of each loss's best setting, a panel per task."""
    figure, axes = panels(len(grids))
    for panel, (task, summary) in zip(axes, grids.items(), strict=True):
        draw_best(panel, dict.fromkeys(summary.best, summary), metric, task)
        panel.set_title(heading(task), fontsize=10)
    for panel in axes[:1]:
        panel.set_ylabel("undiscounted return")
    finish(figure, axes)
    return figure
