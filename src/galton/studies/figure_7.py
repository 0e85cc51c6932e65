"""Figure 7: performance profiles over all trials and settings."""

import numpy as np
from matplotlib.figure import Figure

from galton.analysis.plots import draw_series, finish, look_of, panels
from galton.analysis.statistics import performance_profile
from galton.studies.base import Data, FigureStudy, heading, present
from galton.studies.summary import Summary
from galton.tasks import TASKS


def finals(summary: Summary, loss: str) -> np.ndarray:
    """Final training return of every run of a loss, all settings; NaN for a diverged one."""
    own = [setting for setting in summary.study.settings if setting.config.loss == loss]
    return np.asarray(summary.final("training_return")[summary.rows(*own)])


def draw(data: Data) -> Figure:
    """A panel per task that is done."""
    found = present(data)
    figure, axes = panels(len(found))
    for panel, (task, summary) in zip(axes, found.items(), strict=True):
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


FIGURE = FigureStudy(
    "Performance profiles",
    "Share of all runs of a loss, every setting and trial of its grid, whose final training return exceeds τ, with a "
    "bootstrapped 95% band. A run that diverged exceeds nothing; the lowest 2% of all are left of the panel. The grids "
    "differ: the Gaussian's has learning rates alone, centred HL-Gauss's wider η.",
    tuple(TASKS),
    draw,
)
