"""Why the paper's effect does or does not appear: one thing changed at a time."""

import textwrap
from typing import NamedTuple

import numpy as np
from jaxtyping import Float
from matplotlib.figure import Figure

from galton.analysis.plots import draw_marks, finish, fit, look_of, panels
from galton.analysis.statistics import mean_interval
from galton.studies.base import Data, FigureStudy, heading
from galton.studies.curves import draw_levels
from galton.studies.summary import Summary
from galton.studies.sweeps import CHANGES, WHY_TASKS
from galton.sweep.grid import task_defaults
from galton.sweep.study import Setting
from galton.tasks import TASKS

METRICS = {
    "training_return": "training return",
    "entropy": "entropy, nats",
    "explained_variance": "critic's explained variance, median",
    "edge_share": "actions at the edge",
    "hl_gauss_bias": "HL-Gauss bias",
}
"""Final means of these tell what the policies and critics look like in the end."""


class Outcome(NamedTuple):
    """Of a loss under a change, with the better of its learning rates and η, on fresh seeds."""

    setting: Setting
    finals: dict[str, Float[np.ndarray, " trials"]]
    """By METRICS; NaN for a run that diverged."""


def retrained(data: Data) -> dict[str, Summary]:
    """The winners' runs on fresh seeds, by task, where they are done."""
    return {task: data.sweeps[f"why-{task}-again"] for task in WHY_TASKS if f"why-{task}-again" in data.sweeps}


def outcomes(again: Summary) -> dict[tuple[str, str], Outcome]:
    """By (change, loss)."""
    metrics = {metric: again.final(metric) for metric in METRICS}
    base = task_defaults(again.study.env)
    return {
        (change_of(setting, base), setting.config.loss): Outcome(
            setting, {metric: values[again.rows(setting)] for metric, values in metrics.items()}
        )
        for setting in again.study.settings
    }


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
    """A panel per task: changes across, returns up, a mark per loss; a mean far below all others is written down."""
    found = retrained(data)
    figure, axes = panels(len(found), columns=1)
    figure.set_figwidth(9.5)
    for panel, (task, again) in zip(axes, found.items(), strict=True):
        results = outcomes(again)
        changes = list(dict.fromkeys(change for change, _ in results))
        losses = list(dict.fromkeys(loss for _, loss in results))
        finals = {key: mean_interval(outcome.finals["training_return"]) for key, outcome in results.items()}
        means = np.array([final.mean for final in finals.values()])
        low = min(TASKS[task].at_rest, np.nanmedian(means))
        bottom = low - 2 * (np.nanmax(means) - low)
        fit(panel, [means[means >= bottom], *draw_levels(panel, task)])
        for i, loss in enumerate(losses):
            label, color, _ = look_of(loss)
            shift = 0.16 * (i - (len(losses) - 1) / 2)
            intervals = [finals[change, loss] for change in changes]
            draw_marks(panel, intervals, label, color, shift)
            for x, interval in enumerate(intervals):
                if interval.mean < bottom:
                    at = x + shift, panel.get_ylim()[0]
                    panel.annotate(f" ↓ {interval:.0f}", at, color=color, fontsize=8, va="bottom")
        panel.set_xticks(range(len(changes)), [textwrap.fill(change, 14) for change in changes], fontsize=8)
        panel.set_xlim(-0.5, len(changes) - 0.5)
        panel.set_title(heading(task), fontsize=10)
        panel.set_xlabel("change")
        panel.set_ylabel("final training return")
    finish(figure, axes)
    return figure


FIGURE = FigureStudy(
    "Why: one thing changed at a time",
    "Final training return of each loss (k = 100; HL-Gauss with η = 0.25, centred HL-Gauss with the better of η = 2 "
    "and 4, each with the best of three learning rates up to 0.003) under the paper's settings and with one thing "
    "changed: mean over trials and 95% confidence interval of runs on fresh seeds. Dotted: what the "
    "action 0 earns, always taken. An arrow gives a mean that lies below the axis.",
    tuple(f"why-{task}{part}" for task in WHY_TASKS for part in ("", "-again")),
    draw,
)
