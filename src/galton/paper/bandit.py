"""Figure 3: the bandit under noise, in more dimensions, and with the two controls of §5.2.3."""

import dataclasses
import json
from collections.abc import Mapping, Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from galton.analysis.bands import mean_band
from galton.analysis.plots import draw_series, finish, label_rows, look_of, panels
from galton.analysis.scales import fit_curves
from galton.analysis.statistics import Interval, difference_interval
from galton.losses import LOSSES
from galton.page.page import Claim
from galton.paper import controls
from galton.paper.controls import CONTROLS
from galton.paper.curves import AXES, BANDS, draw_best, draw_levels, numbered, runs_of
from galton.paper.figure import FigureStudy
from galton.paper.measures import CLASSIFICATION, final_return
from galton.paper.summary import Summary
from galton.paper.sweeps import AGAIN, MAIN, Budget, Done, Sweep, on_fresh_seeds
from galton.paper.trained import Trained
from galton.paper.verdicts import claim
from galton.sweep.study import Study

_BANDIT, _BANDIT_AGAIN = MAIN["bandit"], AGAIN["bandit"]


def _with(name: str, constant: str, value: float | int) -> Sweep:
    """The sweep of the bandit's winners on a bandit with another constant, on fresh seeds."""

    def study(budget: Budget, done: Done) -> Study:
        main = done[_BANDIT.name]
        losses = ("gaussian", "hl-gauss") if budget == "smoke" else tuple(main.best)
        settings = tuple(main.best[loss].setting for loss in losses)
        return on_fresh_seeds(dataclasses.replace(main.study, env_kwargs=json.dumps({constant: value})), settings)

    return Sweep(f"bandit-{name}-{value:g}", study, winners_of=_BANDIT)


NOISE = {value: _with("noise", "noise_std", value) for value in (0.0, 2.0, 5.0, 10.0)} | {1.0: _BANDIT_AGAIN}
"""The bandits of Figure 3a by their reward noise, 1 being the bandit's own; the paper doesn't tell its values."""
DIMENSION = {float(d): _with("d", "d", d) for d in (1, 4, 8, 16)} | {2.0: _BANDIT_AGAIN}
"""The bandits of Figure 3b by their action dimensions, 2 being the bandit's own."""


def across(trained: Trained, bandits: Mapping[float, Sweep]) -> dict[float, Summary]:
    """The bandits that are done, by their constant and in its order."""
    found = {value: trained.sweeps[sweep.name] for value, sweep in bandits.items() if sweep.name in trained.sweeps}
    return dict(sorted(found.items()))


def losses_in(bandits: Mapping[float, Summary]) -> list[str]:
    """The losses that were trained on all of these bandits."""
    first, *others = bandits.values()
    return [loss for loss in first.best if all(loss in bandit.best for bandit in others)]


def draw(trained: Trained) -> Figure:
    """Final returns by noise and by dimension, learning curves under the two controls: those that are there."""
    constants = {"noise_std": across(trained, NOISE), "d": across(trained, DIMENSION)}
    constants = {name: bandits for name, bandits in constants.items() if bandits}
    under = {control.label: done for control in CONTROLS if (done := _fresh(trained, control.again, control.sweep))}
    figure, axes = panels(len(constants) + len(under), columns=2, height=2.9)
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
    finish(figure, axes)
    return figure


def _fresh(trained: Trained, again: Sweep, sweep: Sweep) -> Summary | None:
    """The winners on fresh seeds, or where these were not trained the grid."""
    return trained.of(again) or trained.of(sweep)


def _draw_final(axes: Axes, bandits: Mapping[float, Summary]) -> None:
    """Draw the final return of each loss's setting against the bandit's constant."""
    for loss in losses_in(bandits):
        finals = [bandit.best[loss].final_training_return.astype(np.float64) for bandit in bandits.values()]
        draw_series(axes, list(bandits), mean_band([np.stack(finals, axis=1)]), *look_of(loss), marker="o")


def _draw_control(axes: Axes, control: Summary, main: Summary | None) -> list[Interval]:
    """Draw the learning curves under a control, with the Gaussian's and, thin and dotted, those without it."""
    gaussian = {"gaussian": main} if main and "gaussian" in main.best else {}
    drawn = draw_best(axes, gaussian | dict.fromkeys(control.best, control), "training_return")
    for loss in control.best:
        if main and loss in main.best:
            label, color, _ = look_of(loss)
            drawn.append(mean_band([runs_of(main, loss, "training_return")]))
            name = f"{label} without it"
            axes.plot(main.steps, drawn[-1].mean, gid=name, label=name, lw=0.9, ls=":", color=color)
    return drawn


def _share_y(axes: Sequence[Axes]) -> None:
    """Let panels of one quantity have one range."""
    limits = np.array([panel.get_ylim() for panel in axes]).reshape(-1, 2)
    for panel in axes:
        panel.set_ylim(limits[:, 0].min(), limits[:, 1].max())


def less_sensitive_to_noise(trained: Trained) -> Claim:
    """What §5.2.2 says of Figure 3a: noise costs classification less."""
    bandits = across(trained, NOISE)
    gaps: dict[str, Interval] = {}
    if len(bandits) > 1:
        calm, noisy = bandits[min(bandits)], bandits[max(bandits)]
        drops = {loss: final_return(calm, loss) - final_return(noisy, loss) for loss in losses_in(bandits)}
        gaps = {
            LOSSES[loss].label: difference_interval(drops["gaussian"], drops[loss])
            for loss in CLASSIFICATION
            if loss in drops
        }
    return claim(
        "§5.2.2",
        "Classification is less sensitive to noise in the reward.",
        f"bandit, what a noise of {max(bandits, default=0):g} costs in final return: Gaussian's loss − theirs",
        gaps,
    )


def degrades_with_dimension(trained: Trained) -> Claim:
    """What §5.2.2 says of Figure 3b: more dimensions cost every loss something."""
    bandits = across(trained, DIMENSION)
    gaps: dict[str, Interval] = {}
    if len(bandits) > 1:
        few, many = bandits[min(bandits)], bandits[max(bandits)]
        gaps = {
            LOSSES[loss].label: difference_interval(final_return(few, loss), final_return(many, loss))
            for loss in losses_in(bandits)
            if LOSSES[loss].in_paper
        }
    return claim(
        "§5.2.2",
        "All methods degrade as actions get more dimensions.",
        f"bandit, final return: d = {min(bandits, default=0):g} − d = {max(bandits, default=0):g}",
        gaps,
    )


def higher_in_all_dimensions(trained: Trained) -> Claim:
    """What §5.2.2 says of Figure 3b: classification stays ahead of the Gaussian."""
    bandits = across(trained, DIMENSION)
    return claim(
        "§5.2.2",
        "Both classification losses keep a higher final return than the Gaussian at every dimensionality.",
        "bandit, final return − Gaussian's",
        {
            f"{LOSSES[loss].label} d = {d:g}": difference_interval(
                final_return(bandit, loss), final_return(bandit, "gaussian")
            )
            for loss in CLASSIFICATION
            for d, bandit in bandits.items()
            if len(bandits) > 1 and loss in losses_in(bandits)
        },
    )


FIGURE = FigureStudy(
    "The bandit: noise, dimensions, initial policy, exploration",
    "Top: final training return of the settings that win on the bandit itself (noise 1, d = 2), on noisier bandits "
    "and in more dimensions, on one scale. Bottom: the main experiment again, its sweep included, with the softmax "
    "policies starting as the Gaussian does, and sampling from a Gaussian with their own mean and variance; thin and "
    "dotted the same losses without that, from Figure 2, and the Gaussian, which has nothing to change. All on fresh "
    f"seeds: means of n runs, and {BANDS}. {AXES}",
    draw,
    (
        *dict.fromkeys((_BANDIT, _BANDIT_AGAIN, *NOISE.values(), *DIMENSION.values())),
        *(control.sweep for control in CONTROLS),
        *(control.again for control in CONTROLS),
    ),
    number=3,
    claims={
        9: less_sensitive_to_noise,
        10: degrades_with_dimension,
        11: higher_in_all_dimensions,
        12: controls.starts_as_well,
        13: controls.converges_faster,
        14: controls.no_local_optimum,
        15: controls.exploration_is_not_the_reason,
    },
)
