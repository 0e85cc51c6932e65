"""A study of your own: how wide should HL-Gauss's targets be? A sweep, a figure and a claim, as one page."""

from pathlib import Path

import numpy as np

from galton_experiments.analysis import ALPHA, compare, mean_interval
from galton_experiments.analysis.plots import draw_series, finish, look_of, panels, settle
from galton_experiments.page import Claim, Section, render
from galton_experiments.sweep import Study, expand, sweep, task_defaults

OUT = Path("runs/new-study")
SETTINGS = expand([{"loss": "hl-gauss", "eta": [0.1, 0.5, 1.0, 2.0]}], task_defaults("bandit"))
STUDY = Study("bandit", SETTINGS, trials=8, steps=1_000, logs=20, common_seeds=True)


def finals(table):
    """The final training return of each trial, by η."""
    setting, returns = (table.column(name).to_numpy() for name in ("setting", "final_training_return"))
    return {each["eta"]: returns[setting == i] for i, each in enumerate(STUDY.settings)}


def draw(by_eta):
    figure, (axes,) = panels(1)
    intervals = mean_interval(np.stack([*by_eta.values()], axis=1))
    draw_series(axes, [*by_eta], intervals, *look_of("hl-gauss"), marker="o")
    axes.set(xlabel="η", ylabel="final training return")
    finish(figure, [axes])
    settle(figure)
    return figure


def wide_is_better(by_eta):
    found = compare(by_eta[1.0], by_eta[0.1], paired=STUDY.common_seeds)
    clear = found.direction if found.p < ALPHA else 0
    verdict = {1: "holds", -1: "does not hold", 0: "not decidable here"}[clear]
    number = f"{found.difference:+.2f}, P = {found.above:.2f}, p = {found.p:.3f}"
    return Claim("our own", "Wide targets end higher.", "final training return: η = 1 − η = 0.1", number, verdict, "")


if __name__ == "__main__":  # the workers import this file
    by_eta = finals(sweep(STUDY, str(OUT / "sweep")))
    claim = wide_is_better(by_eta)
    section = Section("eta", "How wide a target?", "HL-Gauss on the bandit: mean and 95% interval.", draw(by_eta))
    (OUT / "index.html").write_text(render("Targets", [], [claim], [section]))
    print(f"{claim.words} ({claim.verdict}: {claim.number})\nThe page: {OUT / 'index.html'}")
