"""Figure 7: performance profiles over all trials and settings, and what the paper says of them (§5.1, App. C.4)."""

import functools
from collections.abc import Callable, Sequence

import numpy as np
from jaxtyping import Float
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from scipy import stats

from galton.analysis.bands import mean_band
from galton.analysis.plots import draw_series, finish, label_rows, look_of, panels
from galton.analysis.scales import from_best
from galton.analysis.statistics import Interval, stratified_bootstrap
from galton.page.page import Claim
from galton.paper.curves import counted, heading
from galton.paper.figure import FigureStudy
from galton.paper.measures import CLASSIFICATION, by_setting, progress
from galton.paper.summary import Summary
from galton.paper.sweeps import MAIN
from galton.paper.trained import Trained
from galton.paper.verdicts import claim
from galton.tasks import TASKS

_HIGH = 0.9
"""How much of the way from the first log point to the best setting counts as high."""


def profile(summary: Summary, loss: str, taus: Float[np.ndarray, " T"]) -> Interval:
    """The share of a loss's runs, of every setting, that end above each τ; the trials of each setting are resampled."""
    own = [setting for setting in summary.study.settings if setting.config.loss == loss]
    finals = summary.final("training_return")
    return mean_band([finals[summary.rows(setting), None] > taus for setting in own])


def draw(trained: Trained) -> Figure:
    """The performance profile of each loss over its whole grid, a panel per task that is done."""
    figure, axes = panels(len(trained.grids))
    for panel, (task, summary) in zip(axes, trained.grids.items(), strict=True):
        known = summary.final("training_return")
        known = known[~np.isnan(known)]
        if len(known) and np.ptp(known):
            _from_best(panel, known)
            scale = panel.get_xaxis_transform() - panel.transAxes
            taus = scale.inverted().transform(np.stack([np.linspace(0, 1, 160)] * 2, axis=1))[:, 0]
            for loss in summary.best:
                draw_series(panel, taus, profile(summary, loss, taus), *look_of(loss))
        panel.set_title(f"{heading(task)}\n{counted(summary)}", fontsize=9)
        panel.set_xlabel("τ, final training return")
        panel.set_ylim(0, 1.02)
    label_rows(axes, "share of runs above τ")
    finish(figure, axes)
    return figure


def _from_best(axes: Axes, finals: Float[np.ndarray, " R"]) -> None:
    """An x axis from the worst run to the best, on which no tail is hidden."""
    best, low = float(finals.max()), float(finals.min())
    unit = max(0.5 * (best - float(np.median(finals))), (best - low) / 1000)
    from_best(axes, "x", best, unit, (low, best + 0.1 * unit))


def robust_to_settings(trained: Trained) -> Claim:
    """What §5.1 says of Figure 7: how often classification ends above, whatever the settings."""
    return claim(
        "§5.1",
        "Classification is more robust to hyperparameters.",
        "chance that a run of classification, of any setting, ends above a run of the Gaussian, less ½; mean of "
        "HL-1-Hot and HL-Gauss",
        {TASKS[task].title: _over_gaussian(summary, _above) for task, summary in trained.largest_grids.items()},
    )


def higher_fraction(trained: Trained) -> Claim:
    """What App. C.4 says of Figure 7: the share of runs that reach a high return."""
    gaps = {}
    for task, summary in trained.largest_grids.items():
        start, end = progress(summary)
        if end > start:
            high = start + _HIGH * (end - start)
            gaps[TASKS[task].title] = _over_gaussian(summary, functools.partial(_more_above, high))
    return claim(
        "App. C.4",
        "Over all settings, a higher fraction of classification's runs reaches a high return.",
        "share of runs that end above nine tenths of what training gains with the best setting: mean of HL-1-Hot's and "
        "HL-Gauss's − Gaussian's",
        gaps,
    )


def _above(ours: np.ndarray, theirs: np.ndarray) -> float:
    pairs = stats.mannwhitneyu(ours, theirs, method="asymptotic").statistic
    return float(pairs / (len(ours) * len(theirs)) - 0.5)


def _more_above(high: float, ours: np.ndarray, theirs: np.ndarray) -> float:
    return float((ours > high).mean() - (theirs > high).mean())


def _over_gaussian(summary: Summary, more: Callable[[np.ndarray, np.ndarray], float]) -> Interval:
    """Of all runs of a classification loss against all of the Gaussian, mean of both losses; trials are resampled."""
    groups = [by_setting(summary, loss) for loss in ("gaussian", *CLASSIFICATION)]
    ends = np.cumsum([len(group) for group in groups])[:-1]

    def mean(settings: Sequence[np.ndarray]) -> float:
        theirs, *ours = (group.ravel() for group in np.split(np.array(settings), ends))
        return float(np.mean([more(each, theirs) for each in ours]))

    return stratified_bootstrap([*np.concatenate(groups)], mean, n_resamples=500)


FIGURE = FigureStudy(
    "Performance profiles",
    "Share of all runs of a loss, every setting and trial of its grid, whose final training return exceeds τ; the 95% "
    "band is that of drawing each setting's trials again. A run that diverged exceeds nothing. The axis begins with "
    "the worst run, and is linear near the best and logarithmic far from it. Above each panel stands how much of App. "
    "C.2's grid was trained. The grids differ: the Gaussian's has learning rates alone, centred HL-Gauss's wider η.",
    draw,
    (*MAIN.values(),),
    number=7,
    claims={24: robust_to_settings, 25: higher_fraction},
)
