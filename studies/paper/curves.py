"""Learning curves of each loss's best setting, and what panels of a task share."""

from collections.abc import Mapping

import numpy as np
from jaxtyping import Float
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from galton.losses import LOSSES
from galton.tasks import TASKS
from galton.training import MEAN_ACTION_RETURN
from galton_experiments.analysis import Interval, fit_curves, mean_band
from galton_experiments.analysis.plots import draw_level, draw_series, finish, label_rows, look_of, over_steps, panels
from galton_experiments.runs import Summary
from studies.paper.trained import Trained, optimum, paper_settings


def heading(task: str) -> str:
    """For a panel, as in the paper: with the action's dimensionality."""
    return f"{TASKS[task].title} (d = {TASKS[task].d})"


def shown(trained: Trained) -> dict[str, Summary]:
    """By task the runs that learning curves show: the winners' on fresh seeds, where there are any."""
    return {
        task: trained.judged[task].again if task in trained.judged else trained.grids[task] for task in trained.grids
    }


def numbered(title: str, summary: Summary, every: bool = False) -> str:
    """The title with the number of runs; with a word where a sweep of more than the winners chose these by them."""
    chosen = not every and {best.setting for best in summary.best.values()} != {*summary.study.settings}
    return f"{title}, n = {summary.study.trials}" + (", of the grid" if chosen else "")


def counted(summary: Summary, loss: str | None = None) -> str:
    """For a panel, how many trials of how much of App. C.2's grid a sweep has; of one loss, or of all the paper's."""
    study = summary.study
    grid = {setting for setting in paper_settings(study.env) if loss in (None, setting["loss"])}
    n = len(grid & {*study.settings})
    return f"{study.trials} trials × {len(grid) if n == len(grid) else f'{n} of {len(grid)}'} settings"


def runs_of(summary: Summary, loss: str, metric: str) -> Float[np.ndarray, "trials L"]:
    """The learning curves of the loss's best setting (App. C.2)."""
    return summary.curves(metric)[summary.rows(summary.best[loss].setting)]


def draw_best(axes: Axes, best_of: Mapping[str, Summary], metric: str) -> list[Interval]:
    """Mean and band of each loss's best setting, from the sweep that it is the best of; the axis is not fitted yet."""
    drawn: list[Interval] = []
    for loss, summary in best_of.items():
        runs = runs_of(summary, loss, metric)
        drawn.append(mean_band([runs]))
        draw_series(axes, summary.steps, drawn[-1], *look_of(loss))
        over_steps(axes, float(summary.steps[-1]))
    return drawn


def draw_thin(axes: Axes, summary: Summary, loss: str, metric: str, word: str) -> Interval:
    """Draw the mean of a loss's best setting thin and dotted, with a word behind the loss's name."""
    label, color, _ = look_of(loss)
    found = mean_band([runs_of(summary, loss, metric)])
    axes.plot(summary.steps, found.mean, gid=label + word, label=label + word, lw=0.9, ls=":", color=color)
    return found


def draw_levels(axes: Axes, task: str) -> list[float]:
    """The best that any policy can do, what solves the task, what the action 0 earns: those that are known."""
    values = {"optimum": optimum(task), "solved": TASKS[task].solved, "doing nothing": TASKS[task].at_rest}
    known = {name: value for name, value in values.items() if value is not None}
    for name, value in known.items():
        draw_level(axes, value, name)
    return [*known.values()]


def best_curves(by_task: Mapping[str, Summary], metric: str) -> Figure:
    """The learning curves of each loss's best setting, a panel per task."""
    figure, axes = panels(len(by_task))
    for panel, (task, summary) in zip(axes, by_task.items(), strict=True):
        drawn = draw_best(panel, dict.fromkeys(summary.best, summary), metric)
        fit_curves(panel, drawn, draw_levels(panel, task))
        if metric == "evaluation_return" and MEAN_ACTION_RETURN in summary.table.column_names:
            for loss in (loss for loss in summary.best if LOSSES[loss].family == "histogram"):
                draw_thin(panel, summary, loss, MEAN_ACTION_RETURN, ": mean action")
        panel.set_title(numbered(heading(task), summary), fontsize=10)
    label_rows(axes, "undiscounted return")
    finish(figure, axes)
    return figure
