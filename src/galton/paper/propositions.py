"""Propositions 1 and 2 in training: the figure, its table, and what the paper says of gradients (§4.3)."""

import functools
from collections.abc import Callable, Mapping

import numpy as np
import pyarrow as pa
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from galton.analysis.plots import draw_series, finish, look_of, panels
from galton.analysis.statistics import Comparison, Interval, against, compare
from galton.losses import LOSSES
from galton.page.page import Claim, Table
from galton.paper.bounds import (
    Finding,
    Rows,
    Series,
    crossings,
    findings,
    findings_by_seed,
    of_the_paper,
    parts,
    read,
)
from galton.paper.figure import FigureStudy
from galton.paper.gradients import collect
from galton.paper.measures import CLASSIFICATION
from galton.paper.trained import Trained
from galton.paper.verdicts import NOT_TRAINED, UNKNOWN, claim
from galton.tasks import TASKS

NAME = "propositions"
"""The figure's name, under which `Trained.tables` has what it measures."""
PRINTED = ("gaussian", "sigma")
"""The loss and the reading of σ of Proposition 2 as the paper prints it."""
PRINTED_LABEL = "Gaussian, loss as §4.3 prints it"
_READINGS = {"sigma^2": "(σ²)", "sigma": "(σ)"}
"""What divides the Gaussian's squared error: the variance, as in the likelihood, or σ, as §4.3 prints it."""


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
    """Set the x axis up for looks at ever longer distances: linear at first, then logarithmic."""
    axes.set_xscale("symlog", linthresh=20, linscale=0.5)
    axes.set_xticks([0, *(x for x in (100, 1_000, 10_000, 100_000) if x <= last)])
    axes.set_xlim(0, last)
    axes.set_xlabel("environment steps")


def bounds(trained: Trained) -> Table:
    """The table of how tight the bounds are, how they move over training and as σ → 0."""
    rows = []
    for (task, loss, reading), found in findings(trained.tables[NAME]).items():
        label = PRINTED_LABEL if (loss, reading) == PRINTED else LOSSES[loss].label
        rows.append([TASKS[task].title, label, *("—" if np.isnan(x) else f"{x:.3g}".replace("-", "−") for x in found)])
    headings = ["norm / bound, median", "bound / |A|, mean", "in the end", "its variation", "p in norm ∝ σᵖ"]
    return Table(["task", "loss", *headings], rows)


def bounds_hold(trained: Trained) -> Claim:
    """What §4.3 proves: no sample's gradient exceeds the bound of Proposition 1 or 2."""
    rows = of_the_paper(trained.tables[NAME]) if NAME in trained.tables else None
    above = 0 if rows is None else crossings(rows)
    return Claim(
        "§4.3, Propositions 1 and 2",
        "The gradient's norm never exceeds the bound.",
        "both sides for each action sampled by networks in training, and by trained ones made sharper; both readings "
        "of the Gaussian's σ",
        "" if rows is None else f"{above:,} of {rows.num_rows:,} above the bound",
        UNKNOWN if rows is None else "does not hold" if above else "holds",
        NOT_TRAINED
        if rows is None
        else "The proofs need only the triangle inequality and l as the largest gradient of an output.",
    )


@functools.lru_cache(maxsize=1)
def _by_seed(trained: Trained) -> Mapping[Series, list[Finding]]:
    """What each seed's samples say of the paper's losses; nothing where none were measured."""
    return findings_by_seed(of_the_paper(trained.tables[NAME])) if NAME in trained.tables else {}


def _against_gaussian(trained: Trained, of: Callable[[Finding], float]) -> dict[str, Comparison]:
    """The logarithm of a finding: the Gaussian's less classification's, by task, loss and reading."""
    found = {series: np.log10([of(seed) for seed in seeds]) for series, seeds in _by_seed(trained).items()}
    return {
        f"{TASKS[task].title} {LOSSES[ours].label} {_READINGS[reading]}": compare(values, found[task, ours, ""])
        for (task, loss, reading), values in found.items()
        for ours in CLASSIFICATION
        if loss == "gaussian" and (task, ours, "") in found
    }


def bound_is_smaller(trained: Trained) -> Claim:
    """The last sentence of §4.3: whose bound is the smaller one."""
    last = _against_gaussian(trained, lambda finding: finding.last_per_advantage)
    smaller = [name for name, gap in last.items() if gap.difference.low > 0]
    return claim(
        "§4.3, §8",
        "Classification has a smaller bound on the gradient's norm.",
        "mean bound ÷ mean |A|, averaged over the steps of training: log₁₀(Gaussian ÷ classification), the "
        "Gaussian's loss divided by σ² as in the likelihood or by σ as printed",
        _against_gaussian(trained, lambda finding: finding.per_advantage),
        f"In the end as the paper says: {', '.join(smaller) or 'none'}.",
    )


def bound_varies_less(trained: Trained) -> Claim:
    """The last sentence of §4.3: whose bound moves less while it learns."""
    return claim(
        "§4.3",
        "Classification's bound varies less during learning.",
        "coefficient of variation, over the steps of training, of mean bound ÷ mean |A|: log₁₀(Gaussian ÷ "
        "classification), with σ² or σ",
        _against_gaussian(trained, lambda finding: finding.variation),
    )


def sigma_explodes(trained: Trained) -> Claim:
    """The factor 1/σ of §4.3, on trained policies that are made ever sharper."""
    return claim(
        "§4.3",
        "As σ → 0 the factor 1/σ makes the Gaussian's gradient explode.",
        "p − ½, where norm ÷ |A| (l + ‖f‖) ∝ σ⁻ᵖ as trained policies are made sharper; ½ divides level (0) from 1/σ "
        "(1)",
        {
            f"{TASKS[task].title} {_READINGS[reading]}": against(-np.array([s.exponent for s in seeds]), 0.5)
            for (task, loss, reading), seeds in _by_seed(trained).items()
            if loss == "gaussian"
        },
        "The action's distance from the mean shrinks with σ, so one power of σ cancels.",
    )


FIGURE = FigureStudy(
    "Propositions 1 and 2 in training",
    "Both sides of eqs 7 and 8 for sampled actions of networks in training (the settings of App. C.2, learning rate "
    "7e-4, k = 100, η = 0.25, for centred HL-Gauss 2). First: each sample; nothing lies above the diagonal. Second: "
    "median of norm / bound and the middle 80%. Third: means over samples and seeds. Fourth: trained policies whose σ "
    "is made small (for HL-Gauss: logits times a constant), both sides without what the propositions share. Black is "
    "the Gaussian's own likelihood, (a − μ)² / 2σ², whose bound grows as 1/σ; with the loss as §4.3 prints it, "
    "(a − μ)² / 2σ (grey, dashed), nothing explodes, since |a − μ| shrinks with σ.",
    lambda trained: draw(trained.tables[NAME]),
    table=bounds,
    claims={5: bounds_hold, 6: bound_is_smaller, 7: bound_varies_less, 8: sigma_explodes},
    measure=collect,
)
