"""Propositions 1 and 2 in training: the figure and its table (§4.3)."""

from typing import Any

import numpy as np
import pyarrow as pa
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from galton.losses import LOSSES
from galton.tasks import TASKS
from galton_experiments.analysis import Interval
from galton_experiments.analysis.plots import draw_series, finish, look_of, panels
from galton_experiments.page import Table
from studies.paper import norms
from studies.paper.figure import figure
from studies.paper.gradients import collect
from studies.paper.norms import PRINTED, Rows, check, findings, look_means, parts, read
from studies.paper.trained import Trained

NAME = norms.NAME
"""The figure's name, under which `Trained.tables` has what it measures."""
PRINTED_LABEL = "Gaussian, loss as §4.3 prints it"
Look = tuple[str, str, Any]
"""Label, colour and line style of a series."""


def draw(table: pa.Table) -> Figure:
    """A row of panels per task: how tight the bounds are, bound and norm in training, and the norm as σ → 0."""
    tasks = dict(parts(read(table), "task"))
    drawing, axes = panels(4 * len(tasks), height=2.9)
    for i, ((task,), of_task) in enumerate(tasks.items()):
        row = axes[4 * i : 4 * i + 4]
        row[2].sharey(row[1])  # bound and norm can be compared
        for (loss, reading, swept), rows in parts(of_task, "loss", "reading", "swept"):
            is_printed = reading == PRINTED
            look = (PRINTED_LABEL, "#909090", "--") if is_printed else look_of(loss)
            if swept:
                _draw_sharpened(row[3], rows, look)
                continue
            if not is_printed:  # scales drop out, or nearly
                _draw_tightness(row[0], rows, look)
            _draw_runs(row[1], rows, "bound/|A|", look)
            _draw_runs(row[2], rows, "norm/|A|", look)
        _frame(row, of_task)
        for panel, words in zip(row, _TITLES, strict=True):
            panel.set_title(f"{TASKS[task].title}: {words}", fontsize=9)
    finish(drawing, axes)
    return drawing


_TITLES = ("how tight the bound is", "the bound in training", "the norm in training", "policies made sharper")


def _draw_tightness(axes: Axes, rows: Rows, look: Look) -> None:
    """The median over all samples of a look, and a band from the tenth percentile to the very largest."""
    quantiles = [np.nanquantile(point["tightness"], [0.5, 0.1, 1.0]) for _, point in parts(rows, "step")]
    draw_series(axes, np.unique(rows["step"]), Interval(*np.transpose(quantiles)), *look)


def _draw_runs(axes: Axes, rows: Rows, name: str, look: Look) -> None:
    """The median of the runs' means at each look, and a band over all runs."""
    runs = look_means(rows, name)
    draw_series(axes, np.unique(rows["step"]), Interval(np.median(runs, 0), runs.min(0), runs.max(0)), *look)


def _draw_sharpened(axes: Axes, rows: Rows, look: Look) -> None:
    sigma, norm = look_means(rows, "sigma", "factor").mean(0), look_means(rows, "own norm", "factor").mean(0)
    name, color, linestyle = look
    axes.plot(1 / sigma[sigma > 0], norm[sigma > 0], gid=name, label=name, color=color, ls=linestyle, lw=1.6)


def _frame(row: list[Axes], of_task: Rows) -> None:
    """Scales and words of a task's panels; the last ends where the Gaussian's σ does."""
    tightness, bound, norm, sharpened = row
    tightness.set(ylim=(0, 1.05), ylabel="norm / bound")
    tightness.axhline(1, color="#777777", lw=1)
    for panel, words in ((bound, "bound / |A|"), (norm, "norm / |A|")):
        panel.set(yscale="log", ylabel=words)
    for panel in (tightness, bound, norm):
        _over_steps(panel, int(of_task["step"].max()))
    sharpened.set(xscale="log", yscale="log", xlabel="1 / σ", ylabel="norm / |A| (l + ‖f‖)")
    sharpened.minorticks_off()
    sharpened.set_xlim(1, 1.1 / of_task["sigma"][of_task["loss"] == "gaussian"].min(initial=1.0))


def _over_steps(axes: Axes, last: int) -> None:
    """Set the x axis up for looks at ever longer distances, logarithmic from 100 steps on, with the half marked."""
    axes.set_xscale("symlog", linthresh=100, linscale=0.5)
    axes.set_xticks([0, *(x for x in (100, 1_000, 10_000, 100_000) if x <= last)])
    axes.minorticks_off()
    axes.set_xlim(0, last)
    axes.set_xlabel("environment steps")
    axes.axvline(last / 2, color="#777777", lw=1, ls=":")


def bounds(trained: Trained) -> Table:
    """The table of how tight the bounds are, how large both sides, how they vary and what becomes of them as σ → 0."""
    rows = []
    for (task, loss, reading), found in findings(trained.tables[NAME]).items():
        label = PRINTED_LABEL if reading == PRINTED else LOSSES[loss].label
        rows.append([TASKS[task].title, label, str(len(found.bound)), *map(_median, found)])
    return Table(["task", "loss", "runs", *_HEADINGS.values()], rows)


_HEADINGS = {
    "tightness": "norm / bound",
    "bound": "bound / |A|",
    "own_bound": "bound / |A| (l + ‖f‖)",
    "norm": "norm / |A|",
    "deviation": "SD of bound / |A|",
    "variation": "SD / mean",
    "exponent": "p in norm ∝ σᵖ",
}
"""The table's names for the fields of a Finding."""


def _median(values: np.ndarray) -> str:
    return "—" if np.isnan(values).all() else f"{np.nanmedian(values):.3g}".replace("-", "−")


FIGURE = figure(NAME, lambda trained: draw(trained.tables[NAME]), table=bounds, measure=collect, check=check)
