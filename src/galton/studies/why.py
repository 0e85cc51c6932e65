"""Why the paper's effect does or does not appear: one thing changed at a time."""

from typing import NamedTuple

import numpy as np
from jaxtyping import Float
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from galton.analysis.plots import finish, look_of, panels
from galton.analysis.statistics import Interval, mean_interval
from galton.studies.base import Data, FigureStudy, heading, optimum
from galton.studies.summary import Summary
from galton.studies.sweeps import CHANGES, WHY_TASKS
from galton.sweep.grid import task_defaults
from galton.sweep.study import Setting

METRICS = {
    "training_return": "training return",
    "entropy": "entropy, nats",
    "explained_variance": "critic's explained variance",
    "edge_share": "actions at the edge",
    "hl_gauss_bias": "HL-Gauss bias",
}
"""Final means of these tell what the policies and critics look like in the end."""


class Outcome(NamedTuple):
    """Of a loss under a change, with the better of its learning rates and η."""

    setting: Setting
    finals: dict[str, Float[np.ndarray, " trials"]]
    """By METRICS; NaN for a run that diverged."""


def outcomes(summary: Summary) -> dict[tuple[str, str], Outcome]:
    """By (change, loss). A setting with a run that diverged loses to any other."""
    found: dict[tuple[str, str], Outcome] = {}
    metrics = {metric: summary.final(metric) for metric in METRICS}
    base = task_defaults(summary.study.env)
    for setting in summary.study.settings:
        key = change_of(setting, base), setting.config.loss
        rows = summary.rows(setting)
        outcome = Outcome(setting, {metric: values[rows] for metric, values in metrics.items()})
        if key not in found or _rank(outcome) > _rank(found[key]):
            found[key] = outcome
    return found


def _rank(outcome: Outcome) -> float:
    mean = float(outcome.finals["training_return"].mean())
    return -np.inf if np.isnan(mean) else mean


def change_of(setting: Setting, base: dict[str, object]) -> str:
    """Which of CHANGES it has."""
    record = setting.record()
    fields = {field for change in CHANGES.values() for field in change}
    plain = Setting.of_record(base).record()
    given = {field: record[field] for field in fields if record[field] != plain[field]}
    for name, change in CHANGES.items():
        if {field: value for field, value in change.items() if value != plain[field]} == given:
            return name
    raise ValueError(f"a setting has {given}, which is none of CHANGES")


def draw(data: Data) -> Figure:
    """A panel per task: changes down, returns across, a mark per loss."""
    found = {task: data.sweeps[f"why-{task}"] for task in WHY_TASKS if f"why-{task}" in data.sweeps}
    figure, axes = panels(len(found), columns=3, height=3.8)
    for panel, (task, summary) in zip(axes, found.items(), strict=True):
        results = outcomes(summary)
        changes = list(dict.fromkeys(change for change, _ in results))
        losses = list(dict.fromkeys(loss for _, loss in results))
        for i, loss in enumerate(losses):
            known = [(row, results[change, loss]) for row, change in enumerate(changes) if (change, loss) in results]
            intervals = [mean_interval(outcome.finals["training_return"]) for _, outcome in known]
            _marks(panel, [row + 0.16 * (i - 1.5) for row, _ in known], intervals, *look_of(loss)[:2])
        panel.set_yticks(range(len(changes)), changes if panel is axes[0] else [""] * len(changes))
        panel.invert_yaxis()
        panel.set_title(heading(task), fontsize=10)
        panel.set_xlabel("final training return")
        best = optimum(task)
        if best is not None:
            panel.axvline(best, color="#777777", linestyle="--", linewidth=1, label="optimum")
    finish(figure, axes)
    return figure


def _marks(axes: Axes, rows: list[float], intervals: list[Interval], label: str, color: str) -> None:
    means = [float(interval.mean) for interval in intervals]
    halves = [float(interval.high - interval.mean) for interval in intervals]
    axes.errorbar(means, rows, xerr=halves, fmt="o", ms=4, lw=1.2, color=color, label=label)


FIGURE = FigureStudy(
    "Why: one thing changed at a time",
    "Final training return of each loss (k = 100; HL-Gauss with η = 0.25, centred HL-Gauss with the better of η = 2 "
    "and 4, each with the best of three learning rates up to 0.003) under the paper's settings and with one thing "
    "changed: mean over trials and 95% confidence interval.",
    tuple(f"why-{task}" for task in WHY_TASKS),
    draw,
)
