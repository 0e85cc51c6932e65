"""Figure 7: performance profiles over all trials and settings, and what the paper says of them (§5.1, App. C.4)."""

import functools
from collections.abc import Callable, Sequence

import numpy as np
from matplotlib.figure import Figure
from scipy import stats

from galton.analysis.plots import draw_series, finish, look_of, panels
from galton.analysis.statistics import Interval, performance_profile, stratified_bootstrap
from galton.page.page import Claim
from galton.paper.curves import heading
from galton.paper.figure import FigureStudy
from galton.paper.measures import CLASSIFICATION, by_setting, progress
from galton.paper.summary import Summary
from galton.paper.sweeps import MAIN
from galton.paper.trained import Trained
from galton.paper.verdicts import claim
from galton.tasks import TASKS

_HIGH = 0.9
"""How much of the way from the first log point to the best setting counts as high."""


def finals(summary: Summary, loss: str) -> np.ndarray:
    """Final training return of every run of a loss, all settings; NaN for a diverged one."""
    own = [setting for setting in summary.study.settings if setting.config.loss == loss]
    return np.asarray(summary.final("training_return")[summary.rows(*own)])


def draw(trained: Trained) -> Figure:
    """The performance profile of each loss over its whole grid, a panel per task that is done."""
    figure, axes = panels(len(trained.grids))
    for panel, (task, summary) in zip(axes, trained.grids.items(), strict=True):
        everything = summary.final("training_return")
        known = everything[~np.isnan(everything)]
        low, high = np.quantile(known, [0.02, 1.0]) if len(known) else (0.0, 0.0)
        taus = np.linspace(low, high, 200)
        for loss in summary.best:
            draw_series(panel, taus, performance_profile([finals(summary, loss)], taus), *look_of(loss))
        panel.set_title(heading(task), fontsize=10)
        panel.set_xlabel("τ, final training return")
        panel.set_ylim(0, 1.02)
    axes[0].set_ylabel("share of runs above τ")
    finish(figure, axes)
    return figure


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
    "Share of all runs of a loss, every setting and trial of its grid, whose final training return exceeds τ, with a "
    "bootstrapped 95% band. A run that diverged exceeds nothing; the lowest 2% of all are left of the panel. The grids "
    "differ: the Gaussian's has learning rates alone, centred HL-Gauss's wider η.",
    draw,
    (*MAIN.values(),),
    number=7,
    claims={24: robust_to_settings, 25: higher_fraction},
)
