"""A study of your own: how wide should HL-Gauss's targets be? One sweep, its figure, a claim, and a line in FIGURES."""

from pathlib import Path

import numpy as np

from galton.analysis.plots import draw_series, finish, look_of, panels
from galton.analysis.statistics import compare, mean_interval
from galton.cli.reproduce import reproduce
from galton.paper import FIGURES, FigureStudy, Sweep, claim
from galton.sweep import Study, expand, task_defaults

ETAS = [0.1, 0.5, 1.0, 2.0]


def study(budget, _):
    """More trials the larger the budget; the second argument is what was trained before."""
    trials = {"smoke": 2, "small": 4, "grid": 10, "paper": 20}[budget]
    settings = expand([{"loss": "hl-gauss", "eta": ETAS}], task_defaults("bandit"))
    return Study("bandit", settings, trials, steps=1_000, logs=20)


WIDTHS = Sweep("bandit-eta", study, title="η on the bandit")


def finals(trained):
    """The final training return of each trial, by η."""
    summary = trained.sweeps[WIDTHS.name]
    returns = summary.final("training_return")
    return {setting["eta"]: returns[summary.rows(setting)] for setting in summary.study.settings}


def draw(trained):
    figure, axes = panels(1)
    by_eta = finals(trained)
    intervals = mean_interval(np.stack([*by_eta.values()], axis=1))
    draw_series(axes[0], [*by_eta], intervals, *look_of("hl-gauss"), marker="o")
    axes[0].set(xlabel="η", ylabel="final training return")
    finish(figure, axes)
    return figure


def wide_is_better(trained):
    units = {}
    if WIDTHS.name in trained.sweeps:
        by_eta = finals(trained)
        units = {"bandit": compare(by_eta[1.0], by_eta[0.1])}
    return claim("of our own", "Wide targets end higher.", "final training return: η = 1 − η = 0.1", units)


FIGURES["eta"] = FigureStudy(
    "How wide a target?",
    "Final training return of HL-Gauss on the bandit by η, mean and 95% confidence interval.",
    draw,
    sweeps=(WIDTHS,),
    claims={100: wide_is_better},
)

if __name__ == "__main__":  # the workers import this file
    reproduce(["eta"], "small", Path("runs/new-study"))
