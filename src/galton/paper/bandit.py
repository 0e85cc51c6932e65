"""Figure 3: the bandit under noise, in more dimensions, and with the two controls of §5.2.3."""

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from galton.analysis.plots import draw_series, finish, look_of, panels
from galton.analysis.statistics import mean_interval
from galton.paper import controls, harder_bandits
from galton.paper.controls import CONTROLS
from galton.paper.curves import draw_best
from galton.paper.figure import FigureStudy
from galton.paper.harder_bandits import DIMENSION, NOISE, across, losses_in
from galton.paper.summary import Summary
from galton.paper.sweeps import AGAIN, MAIN
from galton.paper.trained import Trained

_BANDIT, _BANDIT_AGAIN = MAIN["bandit"], AGAIN["bandit"]


def draw(trained: Trained) -> Figure:
    """Final returns by noise and by dimension, learning curves under the two controls: those that are there."""
    constants = {"noise_std": across(trained, NOISE), "d": across(trained, DIMENSION)}
    constants = {name: bandits for name, bandits in constants.items() if bandits}
    under = {control.label: done for control in CONTROLS if (done := trained.of(control.sweep))}
    figure, axes = panels(len(constants) + len(under), columns=2, height=2.9)
    for panel, (name, bandits) in zip(axes, constants.items(), strict=False):
        _draw_final(panel, bandits)
        panel.set_title("Reward noise" if name == "noise_std" else "Action dimensions", fontsize=10)
        panel.set_xlabel("standard deviation of the noise" if name == "noise_std" else "d")
        if name == "d":
            panel.set_xscale("log", base=2)
            panel.xaxis.set_major_formatter("{x:g}")
    for panel, (label, control) in zip(axes[len(constants) :], under.items(), strict=True):
        main = {"gaussian": done} if (done := trained.of(_BANDIT)) else {}
        draw_best(panel, main | dict.fromkeys(control.best, control), "training_return", "bandit")
        panel.set_title(label, fontsize=10)
        panel.set_ylabel("training return")
    finish(figure, axes)
    return figure


def _draw_final(axes: Axes, bandits: dict[float, Summary]) -> None:
    """Draw the final return of each loss's setting against the bandit's constant."""
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
    draw,
    (
        *dict.fromkeys((_BANDIT, _BANDIT_AGAIN, *NOISE.values(), *DIMENSION.values())),
        *(control.sweep for control in CONTROLS),
        *(control.again for control in CONTROLS),
    ),
    number=3,
    claims={
        9: harder_bandits.less_sensitive_to_noise,
        10: harder_bandits.degrades_with_dimension,
        11: harder_bandits.higher_in_all_dimensions,
        11.5: harder_bandits.gap_grows_with_dimension,
        12: controls.starts_as_well,
        13: controls.converges_faster,
        14: controls.no_local_optimum,
        15: controls.exploration_is_not_the_reason,
        16.5: harder_bandits.stops_at_the_next_bin,
    },
)
