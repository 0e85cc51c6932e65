"""Figure 3: the bandit under noise, in more dimensions, and with the two controls of §5.2.3."""

import json
from collections.abc import Mapping

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from galton.analysis.plots import draw_series, finish, look_of, panels
from galton.analysis.statistics import mean_interval
from galton.studies.base import Data, FigureStudy
from galton.studies.curves import draw_best
from galton.studies.summary import Summary
from galton.studies.sweeps import CONTROLS, DIMENSIONS, NOISES

_NOISE = tuple(f"bandit-noise-{noise:g}" for noise in NOISES)
_DIMENSION = tuple(f"bandit-d-{d}" for d in DIMENSIONS)


def across(done: Mapping[str, Summary], constant: str, default: float) -> dict[float, Summary]:
    """The bandits with the winners of the main one, by the constant's value; its own value is the winners' re-run."""
    names = _NOISE if constant == "noise_std" else _DIMENSION
    found = {float(json.loads(done[name].study.env_kwargs)[constant]): done[name] for name in names if name in done}
    if "bandit-again" in done:
        found[default] = done["bandit-again"]
    return dict(sorted(found.items()))


def losses_in(bandits: Mapping[float, Summary]) -> list[str]:
    """Those that were trained on all of them."""
    first, *others = bandits.values()
    return [loss for loss in first.best if all(loss in bandit.best for bandit in others)]


def draw(data: Data) -> Figure:
    """Final returns by noise and by dimension, learning curves under the two controls: those that are there."""
    constants = {"noise_std": across(data.sweeps, "noise_std", 1.0), "d": across(data.sweeps, "d", 2.0)}
    constants = {name: bandits for name, bandits in constants.items() if bandits}
    controls = {name: data.sweeps[name] for name in CONTROLS if name in data.sweeps}
    figure, axes = panels(len(constants) + len(controls), columns=2, height=2.9)
    for panel, (name, bandits) in zip(axes, constants.items(), strict=False):
        _draw_final(panel, bandits)
        panel.set_title("Reward noise" if name == "noise_std" else "Action dimensions", fontsize=10)
        panel.set_xlabel("standard deviation of the noise" if name == "noise_std" else "d")
        if name == "d":
            panel.set_xscale("log", base=2)
            panel.xaxis.set_major_formatter("{x:g}")
    for panel, (name, control) in zip(axes[len(constants) :], controls.items(), strict=True):
        main = {"gaussian": data.sweeps["bandit"]} if "bandit" in data.sweeps else {}
        draw_best(panel, main | dict.fromkeys(control.best, control), "training_return", "bandit")
        panel.set_title(CONTROLS[name], fontsize=10)
        panel.set_ylabel("training return")
    finish(figure, axes)
    return figure


def _draw_final(axes: Axes, bandits: dict[float, Summary]) -> None:
    """Final return of each loss's setting against the bandit's constant."""
    for loss in losses_in(bandits):
        finals = [bandit.best[loss].final_training_return.astype(np.float64) for bandit in bandits.values()]
        draw_series(axes, list(bandits), mean_interval(np.stack(finals, axis=1)), *look_of(loss), marker="o")
    axes.set_ylabel("final training return")


FIGURE = FigureStudy(
    "The bandit: noise, dimensions, initial policy, exploration",
    "Top: final training return of the settings that win on the bandit itself (noise 1, d = 2), on noisier bandits "
    "and in more dimensions, all on fresh seeds. Bottom: the main experiment again, its sweep included, with the "
    "softmax policies starting as the Gaussian does, and sampling from a Gaussian with their own mean and variance; "
    "the Gaussian's curve is that of the main experiment. Means over trials and 95% confidence intervals.",
    ("bandit", "bandit-again", *_NOISE, *_DIMENSION, *CONTROLS, *(f"{name}-again" for name in CONTROLS)),
    draw,
)
