"""Propositions 1 and 2: what the samples of `gradients` say (§4.3)."""

from collections.abc import Iterator
from typing import Any, NamedTuple

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from galton.analysis.plots import draw_series, finish, look_of, panels
from galton.analysis.statistics import Interval
from galton.losses import LOSSES
from galton.studies.base import FigureStudy
from galton.studies.gradients import Sample
from galton.tasks import TASKS

PRINTED = ("gaussian", "sigma")
"""Proposition 2 as the paper has it."""
PRINTED_LABEL = "Gaussian, loss as §4.3 prints it"
Rows = dict[str, np.ndarray]


def read(table: pa.Table) -> Rows:
    """Its columns in float64, |A|, and three that may be NaN: norm / bound, and each over |A| (l + ‖f‖)."""
    rows = {name: np.asarray(table.column(name).to_numpy()) for name in table.column_names}
    rows |= {name: rows[name].astype(np.float64) for name in Sample._fields}
    rows["|advantage|"] = np.abs(rows["advantage"])
    shared = rows["|advantage|"] * (rows["lipschitz"] + rows["feature_norm"])
    for name, (a, b) in {
        "tightness": (rows["norm"], rows["bound"]),
        "shared_norm": (rows["norm"], shared),
        "shared_bound": (rows["bound"], shared),
    }.items():
        rows[name] = np.divide(a, b, out=np.full(len(b), np.nan), where=b > 0)
    return rows


def parts(rows: Rows, *names: str) -> Iterator[tuple[Any, Rows]]:
    """Rows by what they have in these columns, in order of appearance."""
    found: dict[Any, list[int]] = {}
    for i, key in enumerate(zip(*(rows[name].tolist() for name in names), strict=True)):
        found.setdefault(key, []).append(i)
    for key, chosen in found.items():
        yield key, {name: column[chosen] for name, column in rows.items()}


def crossings(table: pa.Table) -> int:
    """Samples whose norm exceeds the bound by more than rounding can; the propositions say none."""
    rows = read(table)
    return int((~(rows["norm"] <= rows["bound"] * (1 + 1e-5) + 1e-20)).sum())


def of_the_paper(table: pa.Table) -> pa.Table:
    """Without centred HL-Gauss."""
    return table.filter(pc.is_in(table.column("loss"), pa.array([name for name in LOSSES if LOSSES[name].in_paper])))


class Finding(NamedTuple):
    """Of a loss in one reading on one task. An average over training gives each look the steps around it."""

    tightness: float
    """Median of norm / bound over all looks."""
    per_advantage: float
    """Mean bound / mean |A| over training: |A| is a factor of both propositions and differs with what was learnt."""
    last_per_advantage: float
    """At the last look."""
    variation: float
    """Of a run's mean bound / mean |A| over training: standard deviation / mean; mean over seeds."""
    exponent: float
    """The p in norm / |A| (l + ‖f‖) ∝ σ^p while the trained policies are made sharper; NaN where they were not."""


def findings(table: pa.Table) -> dict[tuple[str, str, str], Finding]:
    """By task, loss and reading."""
    series = dict(parts(read(table), "task", "loss", "reading", "swept"))
    return {
        (task, loss, reading): Finding(
            tightness=float(np.nanmedian(rows["tightness"])),
            per_advantage=_mean(rows, "bound") / _mean(rows, "|advantage|"),
            last_per_advantage=_mean(last := _last(rows), "bound") / _mean(last, "|advantage|"),
            variation=float(np.mean([_variation(run) for _, run in parts(rows, "seed")])),
            exponent=_exponent(series.get((task, loss, reading, True))),
        )
        for (task, loss, reading, swept), rows in series.items()
        if not swept
    }


def _curve(rows: Rows, name: str) -> tuple[np.ndarray, np.ndarray]:
    """Mean at each look, and how much of training lies nearer to it than to the others."""
    steps, means = zip(*((step, point[name].mean()) for (step,), point in parts(rows, "step")), strict=True)
    ends = np.array([steps[0], *np.convolve(steps, [0.5, 0.5], "valid"), steps[-1]])
    return np.array(means), np.diff(ends) if len(steps) > 1 else np.ones(1)


def _mean(rows: Rows, name: str) -> float:
    means, share = _curve(rows, name)
    return float(np.average(means, weights=share))


def _last(rows: Rows) -> Rows:
    return {name: column[rows["step"] == rows["step"].max()] for name, column in rows.items()}


def _variation(run: Rows) -> float:
    bound, share = _curve(run, "bound")
    ratio = bound / _curve(run, "|advantage|")[0]
    mean = np.average(ratio, weights=share)
    return float(np.sqrt(np.average((ratio - mean) ** 2, weights=share)) / mean)


def _exponent(rows: Rows | None) -> float:
    if rows is None:
        return float("nan")
    points = [(part["sigma"].mean(), np.nanmean(part["shared_norm"])) for _, part in parts(rows, "factor")]
    sigma, norm = np.log([point for point in points if point[0] > 0]).T
    return float(np.polyfit(sigma, norm, 1)[0])


def draw(table: pa.Table) -> Figure:
    """A row of panels per task: both sides of each sample, their quotient, both in training, and both as σ → 0."""
    tasks = dict(parts(read(table), "task"))
    figure, axes = panels(4 * len(tasks), height=2.9)
    for i, ((task,), of_task) in enumerate(tasks.items()):
        samples, tightness, training, sharpened = axes[4 * i : 4 * i + 4]
        for (loss, reading, swept), rows in parts(of_task, "loss", "reading", "swept"):
            is_printed = (loss, reading) == PRINTED
            look = (PRINTED_LABEL, "#909090", "--") if is_printed else look_of(loss)
            if swept:
                _draw_sides(sharpened, rows, "factor", "sigma", "shared_", look)
                continue
            _draw_samples(samples, rows, look)
            _draw_sides(training, rows, "step", "step", "", look)
            if not is_printed:  # scales drop out, or nearly
                _draw_tightness(tightness, rows, look)
        _frame_samples(samples)
        for panel, title in zip((samples, tightness, training, sharpened), _TITLES, strict=True):
            panel.set_title(f"{TASKS[task].title}: {title}", fontsize=9)
        for panel in (tightness, training):
            _over_steps(panel, int(of_task["step"].max()))
        tightness.set_ylim(0, 1.02)
        training.set_yscale("log")
        sharpened.set(xscale="log", yscale="log", xlabel="σ", xlim=(1.0, 5e-6))
    finish(figure, axes)
    return figure


_TITLES = (
    "norm against bound",
    "norm / bound in training",
    "bound, and norm (thin)",
    "both / |A| (l + ‖f‖), as σ → 0",
)


def _draw_samples(axes: Axes, rows: Rows, look: tuple[str, str, str], most: int = 250) -> None:
    name, color, _ = look
    n = len(rows["bound"])
    some = np.linspace(0, n - 1, min(most, n)).astype(int)
    axes.plot(rows["bound"][some], rows["norm"][some], ".", color=color, ms=3.5, alpha=0.4, mew=0, gid=name)


def _frame_samples(axes: Axes) -> None:
    """Square, with the diagonal; above it is where the propositions say that nothing lies."""
    axes.set(xscale="log", yscale="log", xlabel="bound")
    ends = np.array([min(axes.get_xlim()[0], axes.get_ylim()[0]), max(axes.get_xlim()[1], axes.get_ylim()[1])])
    axes.fill_between(ends, ends, ends[1], color="#f0f0f0", linewidth=0, zorder=0)
    axes.plot(ends, ends, color="#777777", lw=1)
    axes.set(xlim=ends, ylim=ends)


def _draw_tightness(axes: Axes, rows: Rows, look: tuple[str, str, str]) -> None:
    quantiles = [np.nanquantile(point["tightness"], [0.5, 0.1, 0.9]) for _, point in parts(rows, "step")]
    draw_series(axes, np.unique(rows["step"]), Interval(*np.transpose(quantiles)), *look)


def _draw_sides(axes: Axes, rows: Rows, by: str, x: str, sides: str, look: tuple[str, str, str]) -> None:
    name, color, linestyle = look
    points = [point for _, point in parts(rows, by)]
    for side, width in (("bound", 1.6), ("norm", 0.7)):
        means = [np.nanmean(point[sides + side]) for point in points]
        at = [point[x].mean() for point in points]
        is_bound = side == "bound"
        gid, label = (name, name) if is_bound else (f"{name}: norm", None)
        axes.plot(at, means, color=color, ls=linestyle, lw=width, gid=gid, label=label)


def _over_steps(axes: Axes, last: int) -> None:
    """Log points are as many early as late."""
    axes.set_xscale("symlog", linthresh=20, linscale=0.5)
    axes.set_xticks([0, *(x for x in (100, 1_000, 10_000, 100_000) if x <= last)])
    axes.set_xlim(0, last)
    axes.set_xlabel("environment steps")


FIGURE = FigureStudy(
    "Propositions 1 and 2 in training",
    "Both sides of eqs 7 and 8 for sampled actions of networks in training (the settings of App. C.2, learning rate "
    "7e-4, k = 100, η = 0.25, for centred HL-Gauss 2). First: each sample; nothing lies above the diagonal. Second: "
    "median of norm / bound and the middle 80%. Third: means over samples and seeds. Fourth: trained policies whose σ "
    "is made small (for HL-Gauss: logits times a constant), both sides without what the propositions share. Black is "
    "the Gaussian's own likelihood, (a − μ)² / 2σ², whose bound grows as 1/σ; with the loss as §4.3 prints it, "
    "(a − μ)² / 2σ (grey, dashed), nothing explodes, since |a − μ| shrinks with σ.",
    (),
    lambda data: draw(data.propositions),
    needs_propositions=True,
)
