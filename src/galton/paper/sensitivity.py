"""Figures 4 to 6: how much a hyperparameter matters, one value held and the rest averaged (App. C.3)."""

import functools
from collections.abc import Callable, Mapping

import numpy as np
from jaxtyping import Float
from matplotlib import colormaps
from matplotlib.colors import to_hex
from matplotlib.figure import Figure
from scipy import stats

from galton.analysis.plots import draw_series, fit, over_steps, panels
from galton.analysis.statistics import Interval, against, compare, mean_interval, within
from galton.losses import LOSSES
from galton.page.page import Claim
from galton.paper.curves import heading
from galton.paper.figure import FigureStudy
from galton.paper.measures import CLASSIFICATION, by_value, spread
from galton.paper.scale import Scale
from galton.paper.summary import Summary
from galton.paper.sweeps import MAIN
from galton.paper.trained import Trained
from galton.paper.verdicts import A_TENTH, Found, by_task, claim, rounded, unit

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


def draw(grids: Mapping[str, Summary], loss: str, fields: tuple[str, ...]) -> Figure:
    """A row per field, a column per task whose sweep varies it."""
    found: list[tuple[str, str, dict[float, Interval], Summary]] = []
    for field in fields:
        for task, summary in grids.items():
            curves = marginals(summary, loss, field, "training_return")
            if len(curves) > 1:
                found.append((field, task, curves, summary))
    columns = max((sum(f == field for f, *_ in found) for field in fields), default=1)
    figure, axes = panels(len(found), columns=min(columns, 4))
    for panel, (field, task, curves, summary) in zip(axes, found, strict=True):
        colors = map(to_hex, colormaps["viridis"](np.linspace(0, 0.85, len(curves))))
        for (value, interval), color in zip(curves.items(), colors, strict=True):
            draw_series(panel, summary.steps, interval, f"{NAMES[field]} = {value:g}", color)
        fit(panel, [interval.mean for interval in curves.values()])
        over_steps(panel, float(summary.steps[-1]))
        panel.set_title(f"{heading(task)}: {NAMES[field]}", fontsize=10)
        panel.legend(fontsize=6.5, labelspacing=0.2)
    for panel in axes[:: min(columns, 4)]:
        panel.set_ylabel("training return")
    return figure


def sensitive(trained: Trained, loss: str, field: str, much: bool, words: str) -> Claim:
    """App. C.3: a field moves the mean final return by more, or less, than a tenth of the way from rest to the best."""

    def judge(task: str, scale: Scale) -> dict[str, Found]:
        moved = spread(trained.whole_grids[task], loss, field, scale)
        if moved is None:
            return {}
        found = against(moved, A_TENTH)
        return {"": unit(found if much else -found, rounded(mean_interval(moved), ""))}

    return claim(
        "App. C.3",
        words,
        "marginal mean final return, best − worst value, rest → best = 1 (values chosen by one half of the trials, "
        "compared by the other); a tenth divides sensitive from robust",
        by_task(trained, trained.whole_grids, judge),
    )


def wide_targets(trained: Trained) -> Claim:
    """What App. C.3 says of Figure 4: the widest targets of the grid do harm."""

    def judge(task: str, scale: Scale) -> dict[str, Found]:
        marginals = [*by_value(trained.whole_grids[task], "hl-gauss", "eta").values()]
        if len(marginals) < 2:
            return {}
        return {"": compare(scale.share(marginals[0]), scale.share(marginals[-1]))}

    return claim(
        "App. C.3",
        "With η too large HL-Gauss degrades.",
        "marginal mean final return, rest → best = 1: smallest − largest η of the grid",
        by_task(trained, trained.whole_grids, judge),
    )


def similar_bins(trained: Trained) -> Claim:
    """App. C.3: the number of bins matters as much for HL-1-Hot as for HL-Gauss, give or take a tenth."""

    def judge(task: str, scale: Scale) -> dict[str, Found]:
        ours, theirs = (spread(trained.whole_grids[task], loss, "n_bins", scale) for loss in CLASSIFICATION)
        if ours is None or theirs is None:
            return {}
        gap = rounded(compare(ours, theirs).difference)
        return {"": unit(within(ours, theirs, A_TENTH), gap)}

    return claim(
        "App. C.3",
        "HL-1-Hot is similarly robust to the number of bins as HL-Gauss.",
        "how much k moves the marginal mean final return, rest → best = 1: HL-1-Hot − HL-Gauss; ✓ differs by less than "
        "a tenth",
        by_task(trained, trained.whole_grids, judge),
    )


def also_sensitive(trained: Trained) -> Claim:
    """App. C.3: the learning rate matters for the other losses too."""

    def judge(task: str, scale: Scale) -> dict[str, Found]:
        grid = trained.whole_grids[task]
        moved = {loss: spread(grid, loss, "learning_rate", scale) for loss in ("gaussian", *CLASSIFICATION)}
        theirs = moved["hl-gauss"]
        return {
            LOSSES[loss].label: compare(ours, theirs)
            for loss in ("gaussian", "hl-one-hot")
            if (ours := moved[loss]) is not None and theirs is not None
        }

    return claim(
        "App. C.3",
        "The Gaussian and HL-1-Hot are also sensitive to the learning rate, as HL-Gauss is.",
        "how much the learning rate moves the marginal mean final return, rest → best = 1: theirs − HL-Gauss's; ✓ is "
        "not clearly less",
        by_task(trained, trained.whole_grids, judge),
        unless_contrary=True,
    )


def _figure(
    number: int,
    loss: str,
    label: str,
    fields: tuple[str, ...],
    claims: Mapping[int | float, Callable[[Trained], Claim]],
) -> FigureStudy:
    names = ", ".join(NAMES[field] for field in fields)
    return FigureStudy(
        f"Sensitivity of {label}",
        f"Training return of {label} with one hyperparameter held ({names}) and all other settings of the grid "
        "averaged: mean and 95% confidence interval over trials. Where others are averaged in, no curve can be better "
        "than Figure 2's.",
        lambda trained: draw(trained.grids, loss, fields),
        (*MAIN.values(),),
        number,
        claims=claims,
    )


def _says(loss: str, field: str, much: bool, words: str) -> Callable[[Trained], Claim]:
    return functools.partial(sensitive, loss=loss, field=field, much=much, words=words)


HL_GAUSS = _figure(
    4,
    "hl-gauss",
    "HL-Gauss",
    ("learning_rate", "n_bins", "eta"),
    {
        17: _says("hl-gauss", "learning_rate", True, "HL-Gauss is sensitive to the learning rate."),
        18: _says("hl-gauss", "eta", True, "HL-Gauss is sensitive to η."),
        19: wide_targets,
        20: _says("hl-gauss", "n_bins", False, "HL-Gauss is robust to the number of bins."),
    },
)
HL_ONE_HOT = _figure(
    5,
    "hl-one-hot",
    "HL-1-Hot",
    ("learning_rate", "n_bins"),
    {
        21: _says("hl-one-hot", "n_bins", False, "HL-1-Hot is robust to the number of bins."),
        21.5: similar_bins,
        22: _says("hl-one-hot", "learning_rate", True, "HL-1-Hot is sensitive to the learning rate."),
    },
)
GAUSSIAN = _figure(
    6,
    "gaussian",
    "the Gaussian",
    ("learning_rate",),
    {
        23: _says("gaussian", "learning_rate", True, "The Gaussian is sensitive to the learning rate."),
        23.5: also_sensitive,
    },
)
