"""How much a hyperparameter matters: one value held, the rest averaged (App. C.3)."""

import numpy as np
from jaxtyping import Float
from matplotlib import colormaps
from matplotlib.figure import Figure
from scipy import stats

from galton.analysis.plots import draw_series, fit, over_steps, panels
from galton.analysis.statistics import Interval, mean_interval
from galton.studies.base import Data, FigureStudy, heading, present
from galton.studies.summary import Summary
from galton.tasks import TASKS

NAMES = {"learning_rate": "learning rate", "n_bins": "k", "eta": "η"}


def marginals(summary: Summary, loss: str, field: str, metric: str) -> dict[float, Interval]:
    """For each value of a field, the mean curve over all settings of a loss that have it, `[L]`.

    The interval is that of the mean over these very settings: trials are the sample, settings are strata.
    """
    curves = summary.curves(metric)
    groups: dict[float, list[np.ndarray]] = {}
    for setting in summary.study.settings:
        if setting.config.loss == loss:
            runs = curves[summary.rows(setting)]
            groups.setdefault(float(setting.record()[field]), []).append(runs)
    return {value: stratified_mean(group) for value, group in sorted(groups.items())}


def stratified_mean(strata: list[Float[np.ndarray, "n *rest"]]) -> Interval:
    """The mean of the strata's means and its 95% interval; NaN samples are left out of theirs."""
    each = [mean_interval(stratum) for stratum in strata]
    mean = np.mean([interval.mean for interval in each], axis=0)
    freedom = np.array([np.maximum((~np.isnan(stratum)).sum(0) - 1, 1) for stratum in strata])
    errors = np.array([interval.high - interval.mean for interval in each]) / stats.t.ppf(0.975, freedom)
    half = stats.t.ppf(0.975, freedom.sum(0)) * np.sqrt((errors**2).sum(0)) / len(strata)
    return Interval(mean, mean - half, mean + half)


def draw_sensitivity(data: Data, loss: str, fields: tuple[str, ...]) -> Figure:
    """A row per field, a column per task whose sweep varies it."""
    found: list[tuple[str, str, dict[float, Interval], Summary]] = []
    for field in fields:
        for task, summary in present(data).items():
            curves = marginals(summary, loss, field, "training_return")
            if len(curves) > 1:
                found.append((field, task, curves, summary))
    columns = max((sum(f == field for f, *_ in found) for field in fields), default=1)
    figure, axes = panels(len(found), columns=min(columns, 4))
    for panel, (field, task, curves, summary) in zip(axes, found, strict=True):
        colors = colormaps["viridis"](np.linspace(0, 0.85, len(curves)))
        for (value, interval), color in zip(curves.items(), colors, strict=True):
            draw_series(panel, summary.steps, interval, f"{NAMES[field]} = {value:g}", color)
        fit(panel, [interval.mean for interval in curves.values()])
        over_steps(panel, float(summary.steps[-1]))
        panel.set_title(f"{heading(task)}: {NAMES[field]}", fontsize=10)
        panel.legend(fontsize=6.5, labelspacing=0.2)
    for panel in axes[:: min(columns, 4)]:
        panel.set_ylabel("training return")
    return figure


def study(loss: str, label: str, fields: tuple[str, ...]) -> FigureStudy:
    """Of a loss: Figure 4, 5 or 6."""

    def draw(data: Data) -> Figure:
        return draw_sensitivity(data, loss, fields)

    names = ", ".join(NAMES[field] for field in fields)
    return FigureStudy(
        f"Sensitivity of {label}",
        f"Training return of {label} with one hyperparameter held ({names}) and all other settings of the grid "
        "averaged: mean and 95% confidence interval over trials. Where others are averaged in, no curve can be better "
        "than Figure 2's.",
        tuple(TASKS),
        draw,
    )
