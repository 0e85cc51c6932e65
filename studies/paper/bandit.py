"""Figure 3: the bandit under noise, in more dimensions, and with the two controls of §5.2.3."""

from collections.abc import Mapping, Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from galton_experiments.analysis import Interval, fit_curves, mean_band
from galton_experiments.analysis.plots import draw_series, finish, label_rows, look_of, marker_of, panels
from galton_experiments.runs import Summary
from studies.paper.controls import CONTROLS
from studies.paper.curves import draw_best, draw_levels, draw_thin, numbered
from studies.paper.figure import figure
from studies.paper.harder_bandits import DIMENSION, NOISE, across, losses_in
from studies.paper.sweeps import AGAIN, MAIN, Sweep
from studies.paper.trained import Trained

_BANDIT, _BANDIT_AGAIN = MAIN["bandit"], AGAIN["bandit"]


def draw(trained: Trained) -> Figure:
    """Final returns by noise and by dimension, learning curves under the two controls: those that are there."""
    constants = {"noise_std": across(trained, NOISE), "d": across(trained, DIMENSION)}
    constants = {name: bandits for name, bandits in constants.items() if bandits}
    under = {control.label: done for control in CONTROLS if (done := _fresh(trained, control.again, control.sweep))}
    drawing, axes = panels(len(constants) + len(under), columns=2, height=2.9)
    finals, curves = axes[: len(constants)], axes[len(constants) :]
    for panel, (name, bandits) in zip(finals, constants.items(), strict=True):
        _draw_final(panel, bandits)
        panel.set_xlabel("standard deviation of the reward's noise" if name == "noise_std" else "action dimensions d")
        title = "Bandit: reward noise" if name == "noise_std" else "Bandit: action dimensions"
        panel.set_title(f"{title}, n = {min(bandit.study.trials for bandit in bandits.values())}", fontsize=10)
        if name == "d":
            panel.set_xscale("log", base=2)
            panel.xaxis.set_major_formatter("{x:g}")
    main = _fresh(trained, _BANDIT_AGAIN, _BANDIT)
    drawn = [curve for i, done in enumerate(under.values()) for curve in _draw_control(curves[i], done, main)]
    for panel, (label, control) in zip(curves, under.items(), strict=True):
        fit_curves(panel, drawn, draw_levels(panel, "bandit"))
        panel.set_title(numbered(f"Bandit: {label}", control), fontsize=10)
    _share_y(finals)
    label_rows(finals, "final training return")
    label_rows(curves, "training return")
    finish(drawing, axes)
    return drawing


def _fresh(trained: Trained, again: Sweep, sweep: Sweep) -> Summary | None:
    """The winners on fresh seeds, or where these were not trained the grid."""
    return trained.of(again) or trained.of(sweep)


def _draw_final(axes: Axes, bandits: Mapping[float, Summary]) -> None:
    """Draw the final return of each loss's setting against the bandit's constant."""
    for loss in losses_in(bandits):
        finals = [bandit.best[loss].final_training_return.astype(np.float64) for bandit in bandits.values()]
        draw_series(axes, list(bandits), mean_band([np.stack(finals, axis=1)]), *look_of(loss), marker=marker_of(loss))


def _draw_control(axes: Axes, control: Summary, main: Summary | None) -> list[Interval]:
    """Draw the learning curves under a control, with the Gaussian's and, thin and dotted, those without it."""
    gaussian = {"gaussian": main} if main and "gaussian" in main.best else {}
    drawn = draw_best(axes, gaussian | dict.fromkeys(control.best, control), "training_return")
    known = [loss for loss in control.best if main and loss in main.best]
    return drawn + [draw_thin(axes, main, loss, "training_return", " without it") for loss in known if main]


def _share_y(axes: Sequence[Axes]) -> None:
    """Let panels of one quantity have one range."""
    limits = np.array([panel.get_ylim() for panel in axes]).reshape(-1, 2)
    for panel in axes:
        panel.set_ylim(limits[:, 0].min(), limits[:, 1].max())


FIGURE = figure(
    "figure-3",
    draw,
    (
        *dict.fromkeys((_BANDIT, _BANDIT_AGAIN, *NOISE.values(), *DIMENSION.values())),
        *(control.sweep for control in CONTROLS),
        *(control.again for control in CONTROLS),
    ),
)
