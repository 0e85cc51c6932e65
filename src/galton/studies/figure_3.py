"""Figure 3: the bandit under noise, in more dimensions, and with the two controls of §5.2.3."""

import json

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from galton.analysis.plots import draw_series, finish, look_of, panels
from galton.analysis.statistics import mean_interval
from galton.studies.base import FigureStudy, optimum
from galton.studies.curves import draw_best
from galton.studies.summary import Summary
from galton.studies.sweeps import DIMENSIONS, NOISES, Done

_NOISE = tuple(f"bandit-noise-{noise:g}" for noise in NOISES)
_DIMENSION = tuple(f"bandit-d-{d}" for d in DIMENSIONS)
CONTROLS = {"bandit-init-gaussian": "Init Gaussian", "bandit-gaussian-exploration": "Gaussian Exploration"}


def across(done: Done, constant: str, default: float) -> dict[float, Summary]:
    """The bandits with the winners of the main one, by the constant's value; its own value is the winners' re-run."""
    names = _NOISE if constant == "noise_std" else _DIMENSION
    found = {json.loads(done[name].study.env_kwargs)[constant]: done[name] for name in names if name in done}
    if "bandit-again" in done:
        found[default] = done["bandit-again"]
    return dict(sorted(found.items()))


def _final(axes: Axes, bandits: dict[float, Summary]) -> None:
    """Final return of each loss's setting against the bandit's constant."""
    if not bandits:
        return
    losses = [setting.config.loss for setting in next(iter(bandits.values())).study.settings]
    for loss in losses:
        finals = [b.best[loss].final_training_return.astype(np.float64) for b in bandits.values()]
        interval = mean_interval(np.stack(finals, axis=1))
        draw_series(axes, list(bandits), interval, *look_of(loss), marker="o")
    axes.set_ylabel("final training return")


def draw(done: Done) -> Figure:
    """The four panels."""
    figure, axes = panels(4, columns=2, height=2.9)
    _final(axes[0], across(done, "noise_std", 1.0))
    axes[0].set_xlabel("standard deviation of the reward's noise")
    _final(axes[1], across(done, "d", 2))
    axes[1].set_xlabel("action dimensions d")
    axes[1].set_xscale("log", base=2)
    axes[1].xaxis.set_major_formatter("{x:g}")
    for panel, (name, title) in zip(axes[2:], CONTROLS.items(), strict=True):
        if name in done and "bandit" in done:
            best_of = {"gaussian": done["bandit"]} | dict.fromkeys(done[name].best, done[name])
            draw_best(panel, best_of, "training_return", optimum("bandit"))
        panel.set_title(title, fontsize=10)
        panel.set_ylabel("training return")
    finish(figure, axes, columns=5)
    return figure


FIGURE = FigureStudy(
    "The bandit: noise, dimensions, initial policy, exploration",
    "Top: final training return of the settings that win on the bandit itself (noise 1, d = 2), on noisier bandits "
    "and in more dimensions, all on fresh seeds. Bottom: the main experiment again, its sweep included, with the "
    "softmax policies starting as the Gaussian does, and sampling from a Gaussian with their own mean and variance; "
    "the Gaussian's curve is that of the main experiment. Means over trials and 95% confidence intervals.",
    ("bandit", "bandit-again", *_NOISE, *_DIMENSION, *CONTROLS),
    draw,
)
