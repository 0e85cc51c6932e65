"""Figure 7: performance profiles over all trials and settings, and what the paper says of them (§5.1, App. C.4)."""

import numpy as np
from jaxtyping import Float
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from galton.tasks import TASKS
from galton_experiments.analysis import Interval, compare, difference_interval, from_best, mean_band, rounded
from galton_experiments.analysis.plots import draw_series, finish, label_rows, look_of, panels
from galton_experiments.page import Claim
from galton_experiments.runs import Summary
from galton_experiments.sweep import mean_returns
from studies.paper.curves import counted, heading
from studies.paper.figure import figure
from studies.paper.measures import CLASSIFICATION, by_setting, rate_spreads
from studies.paper.prose import note, says
from studies.paper.sweeps import MAIN
from studies.paper.trained import Scale, Trained
from studies.paper.verdicts import Found, by_task, claim

_HIGH = 0.9
"""The share of the way from rest to the best setting that counts as high."""


def profile(summary: Summary, loss: str, taus: Float[np.ndarray, " T"]) -> Interval:
    """The share of a loss's runs, of every setting, that end above each τ; the trials of each setting are resampled."""
    own = [setting for setting in summary.study.settings if setting["loss"] == loss]
    finals = summary.final("training_return")
    return mean_band([finals[summary.rows(setting), None] > taus for setting in own])


def draw(trained: Trained) -> Figure:
    """The performance profile of each loss over its whole grid, a panel per task that is done."""
    drawing, axes = panels(len(trained.grids))
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
    finish(drawing, axes)
    return drawing


def _from_best(axes: Axes, finals: Float[np.ndarray, " R"]) -> None:
    """An x axis from the worst run to the best, on which no tail is hidden."""
    best, low = float(finals.max()), float(finals.min())
    unit = max(0.5 * (best - float(np.median(finals))), (best - low) / 1000)
    from_best(axes, "x", best, unit, (low, best + 0.1 * unit))


def robust_to_settings(trained: Trained) -> Claim:
    """Judge what §5.1 says of Figure 7: how much settings matter, by those that all losses have in common."""

    def judge(task: str, scale: Scale) -> dict[str, Found]:
        pairs = rate_spreads(trained.whole_grids[task], CLASSIFICATION, "gaussian", scale)
        return {name: compare(theirs, ours) for name, (ours, theirs) in pairs.items()}

    judged = {task: grid for task, grid in trained.whole_grids.items() if task in trained.scales}
    shown = "; ".join(f"{TASKS[task].title} {rounded(level(grid))}" for task, grid in judged.items())
    units = by_task(trained, trained.whole_grids, judge)
    return claim(*says("robust_to_settings"), units, note("robust_to_settings", shown=shown) if shown else "")


def higher_fraction(trained: Trained) -> Claim:
    """Judge what App. C.4 says of Figure 7: the share of runs that reach a high return."""

    def judge(task: str, scale: Scale) -> dict[str, Found]:
        grid = trained.whole_grids[task]
        best = max(mean_returns(grid.study, grid.table).values())
        if not best > scale.rest:
            return {}
        high = scale._replace(best=best).at(_HIGH)
        theirs, *ours = ((by_setting(grid, loss) > high).mean(0) for loss in ("gaussian", *CLASSIFICATION))
        return {"": compare(np.mean(ours, axis=0), theirs)}

    return claim(*says("higher_fraction"), by_task(trained, trained.whole_grids, judge))


def level(grid: Summary) -> Interval:
    """P(a run of classification ends above one of the Gaussian) − ½, of all settings, mean of HL-1-Hot and HL-Gauss.

    Trials are the sample, settings are fixed. A trial's placement is the share of the other side's runs that it is
    above; the variance of P is the sum of those of both sides' mean placements (DeLong et al. 1988), which is that of
    their difference, 2P − 1.
    """
    theirs = by_setting(grid, "gaussian")
    both = [_placements(by_setting(grid, loss), theirs) for loss in CLASSIFICATION]
    ours, of_gaussian = np.mean(both, axis=0)
    twice, low, high = difference_interval(ours, of_gaussian)
    return Interval(twice / 2, low - twice / 2, high - twice / 2)


def _placements(a: Float[np.ndarray, "s n"], b: Float[np.ndarray, "t n"]) -> Float[np.ndarray, "2 n"]:
    """The mean share of b's runs that each of a's trials is above, and of a's that each of b's is; ties count half."""

    def placed(runs: np.ndarray, others: np.ndarray) -> np.ndarray:
        known = np.sort(others.ravel())
        below = [np.searchsorted(known, runs, side) for side in ("left", "right")]
        return np.asarray(np.mean(below, axis=0).mean(0) / len(known))

    return np.stack([placed(a, b), placed(b, a)])


FIGURE = figure("figure-7", draw, (*MAIN.values(),))
