"""Propositions 1 and 2: what the samples of `gradients` say (§4.3)."""

from collections.abc import Callable, Iterator
from typing import Any, NamedTuple

import numpy as np
import pyarrow as pa
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from galton.analysis.plots import draw_series, finish, look_of, panels
from galton.analysis.statistics import Interval
from galton.studies.base import FigureStudy
from galton.studies.gradients import Sample
from galton.studies.sweeps import TASKS

PRINTED = ("gaussian", "sigma")
"""Proposition 2 as the paper has it."""
PRINTED_LABEL = "Gaussian, loss as §4.3 prints it"
Rows = dict[str, np.ndarray]


def read(table: pa.Table) -> Rows:
    """Its columns in float64, and three more, NaN where not defined: norm / bound, and each over |A| (l + ‖f‖)."""
    rows = {name: np.asarray(table.column(name).to_numpy()) for name in table.column_names}
    rows |= {name: rows[name].astype(np.float64) for name in Sample._fields}
    shared = np.abs(rows["advantage"]) * (rows["lipschitz"] + rows["feature_norm"])
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


class Finding(NamedTuple):
    """Of a loss in one reading on one task; ratios are to Proposition 2 as printed."""

    tightness: float
    """Median of norm / bound."""
    bound: float
    """Its mean over samples, log points and seeds."""
    bound_ratio: float
    per_advantage: float
    """Mean bound / mean |A|, which is a factor of both propositions and differs with what a policy has learnt."""
    per_advantage_ratio: float
    final_per_advantage_ratio: float
    """At the last log point."""
    variation: float
    """Of a run's mean bound from log point to log point: standard deviation / mean; mean over seeds."""
    variation_per_advantage: float
    """The same of mean bound / mean |A|."""
    exponent: float
    """The p in bound / |A| (l + ‖f‖) ∝ σ^p while the trained policies are made sharper; NaN where they were not."""


def findings(table: pa.Table) -> dict[tuple[str, str, str], Finding]:
    """By task, loss and reading."""
    found = {}
    for (task,), of_task in parts(read(table), "task"):
        series = dict(parts(of_task, "loss", "reading", "swept"))
        printed = series[*PRINTED, False]
        for (loss, reading, swept), rows in series.items():
            if not swept:
                found[task, loss, reading] = Finding(
                    tightness=float(np.nanmedian(rows["tightness"])),
                    bound=_mean(rows),
                    bound_ratio=_mean(rows) / _mean(printed),
                    per_advantage=_per_advantage(rows),
                    per_advantage_ratio=_per_advantage(rows) / _per_advantage(printed),
                    final_per_advantage_ratio=_per_advantage(_last(rows)) / _per_advantage(_last(printed)),
                    variation=_variation(rows, _mean),
                    variation_per_advantage=_variation(rows, _per_advantage),
                    exponent=_exponent(series.get((loss, reading, True))),
                )
    return found


def _mean(rows: Rows) -> float:
    return float(rows["bound"].mean())


def _per_advantage(rows: Rows) -> float:
    return _mean(rows) / float(np.abs(rows["advantage"]).mean())


def _last(rows: Rows) -> Rows:
    return {name: column[rows["step"] == rows["step"].max()] for name, column in rows.items()}


def _variation(rows: Rows, mean: Callable[[Rows], float]) -> float:
    curves = [[mean(point) for _, point in parts(run, "step")] for _, run in parts(rows, "seed")]
    return float(np.mean(np.std(curves, axis=1) / np.mean(curves, axis=1)))


def _exponent(rows: Rows | None) -> float:
    if rows is None:
        return float("nan")
    points = [(part["sigma"].mean(), np.nanmean(part["shared_bound"])) for _, part in parts(rows, "factor")]
    sigma, bound = np.log([point for point in points if point[0] > 0]).T
    return float(np.polyfit(sigma, bound, 1)[0])


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
        samples.set_ylabel(TASKS[task].title, fontsize=11)
        for panel in (tightness, training):
            _over_steps(panel, int(of_task["step"].max()))
        tightness.set_ylim(0, 1.02)
        training.set_yscale("log")
        sharpened.set(xscale="log", yscale="log", xlabel="σ", xlim=(1.0, 5e-6))
    for panel, title in zip(axes, _TITLES, strict=False):
        panel.set_title(title, fontsize=10)
    finish(figure, axes)
    return figure


_TITLES = (
    "norm against bound, each sample",
    "norm / bound in training",
    "mean bound, and mean norm (thin)",
    "the same / |A| (l + ‖f‖), as σ → 0",
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
        axes.plot(at, means, color=color, ls=linestyle, lw=width, gid=name, label=name if side == "bound" else None)


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
