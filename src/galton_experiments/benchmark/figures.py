"""The figures of a benchmark's page."""

from collections.abc import Callable

import numpy as np
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from galton.words import CHOICES
from galton_experiments.analysis.plots import colors_of, draw_marks, draw_series, finish, label_rows, over_steps, panels
from galton_experiments.analysis.scales import fit_curves
from galton_experiments.analysis.statistics import Interval, mean_interval
from galton_experiments.benchmark import tables
from galton_experiments.benchmark.found import Found
from galton_experiments.benchmark.protocol import Method
from galton_experiments.benchmark.stages import Role, Stage

_SERIES: dict[tuple[Stage, Role], tuple[str, str, str]] = {
    ("fresh", "shared"): ("tuning tasks, one setting for all", "o", "#0072B2"),
    ("fresh", "per-task"): ("tuning tasks, a setting for each", "s", "#56B4E9"),
    ("held-out", "shared"): ("held-out tasks, the same one setting", "D", "#D55E00"),
}
"""Name, mark and colour of what has a score."""

MOST_CURVES = 8
"""Methods in a panel of curves: as many as there are colours that anybody can tell apart."""


def scores(found: Found) -> Figure:
    """Mean normalised scores with their intervals, by method from above to below; by both returns."""
    standings = found.standings
    there = [(stage, role) for stage, role in _SERIES if stage in standings]
    labels = [method.label for method in found.protocol.methods]
    figure, axes = panels(2 if there else 0, width=3.9, height=0.7 + 0.3 * len(labels))
    for panel, curve, title in zip(
        axes, ("judged", "training"), (tables.metric(found), "training return"), strict=False
    ):
        for i, (stage, role) in enumerate(there):
            of_method = standings[stage].scores
            marks = [getattr(of_method[method.name][role], curve) for method in found.protocol.methods]
            name, mark, shade = _SERIES[stage, role]
            draw_marks(panel, marks, name, shade, (i - (len(there) - 1) / 2) * 0.22, mark, across=True)
        panel.set_title(title, fontsize=10)
        panel.set_xlabel("mean percentile")
        panel.set_yticks(range(len(labels)), labels if panel is axes[0] else [""] * len(labels))
        panel.set_ylim(len(labels) - 0.5, -0.5)
    finish(figure, axes)
    return figure


def best_of(found: Found) -> Figure:
    """Plot the best of n draws, for one setting and for one for each task; nothing where there is but one draw."""
    kinds = {"shared": "one setting for all tuning tasks", "per_task": "a setting for each tuning task"}
    kinds = kinds if found.protocol.budget.settings > 1 else {}
    figure, axes = panels(len(kinds), height=3.1, width=3.9)
    for panel, (kind, title) in zip(axes, kinds.items(), strict=True):
        for method, shade in zip(leading(found), colors(found), strict=True):
            got = getattr(found.best_of[method.name], kind)
            draw_series(panel, np.arange(1, len(got) + 1), Interval(got, got, got), method.label, shade, "-", "o")
        panel.set_title(title, fontsize=10)
        panel.set_xlabel("draws")
        panel.xaxis.set_major_locator(MaxNLocator(integer=True))
    label_rows(axes, "mean percentile of the best")
    finish(figure, axes)
    return figure


def curves(found: Found) -> Figure:
    """Plot the metric that judges runs over environment steps, of the shared settings on each task, on fresh seeds."""
    stages = [runs for of_stage in found.later.values() for runs in of_stage]
    figure, axes = panels(len(stages), columns=3)
    for panel, runs in zip(axes, stages, strict=True):
        drawn, last = [], 0.0
        for method, shade in zip(leading(found), colors(found), strict=True):
            steps, of_runs = runs.curves(method.name, "shared")
            last = max(last, float(steps[-1]))
            drawn.append(mean_interval(of_runs))
            draw_series(panel, steps, drawn[-1], method.label, shade, "-")
        fit_curves(panel, drawn)
        held_out = " (held out)" if runs.stage == "held-out" else ""
        panel.set_title(f"{runs.part.task.label}{held_out}", fontsize=10)
        over_steps(panel, last)
    label_rows(axes, tables.metric(found))
    finish(figure, axes)
    return figure


def colors(found: Found) -> list[str]:
    """The colours of the leading methods."""
    fixed = [{**found.protocol.fixed, **method.fixed}.get("loss") for method in leading(found)]
    return colors_of([str(CHOICES["loss"].usual if loss is None else loss.values[0]) for loss in fixed])


def leading(found: Found) -> list[Method]:
    """The methods whose curves are drawn, in the file's order: all of them, or the baseline and those ahead.

    Ahead are those whose shared setting has the highest score: on fresh seeds of the tuning tasks, or among the draws.
    """
    methods, base = found.protocol.methods, found.protocol.baseline
    if len(methods) <= MOST_CURVES:
        return list(methods)
    standings = found.standings.get("fresh")

    def score(method: Method) -> float:
        if standings:
            return float(standings.scores[method.name]["shared"].judged.mean)
        return float(found.best_of[method.name].shared[-1])

    ahead = sorted((method for method in methods if method != base), key=score, reverse=True)[: MOST_CURVES - 1]
    return [method for method in methods if method == base or method in ahead]


def few(found: Found) -> str:
    """Return a sentence for captions where not all methods are drawn; none where all are."""
    if len(leading(found)) == len(found.protocol.methods):
        return ""
    return f"Of all methods {MOST_CURVES} are drawn: the baseline and those with the highest scores."


FIGURES: dict[str, Callable[[Found], Figure]] = {"scores": scores, "curves": curves, "best-of-n": best_of}
"""The figures by name; one without axes is left out."""
