"""Figures 4 to 6: how much a hyperparameter matters, one value held and the rest averaged (App. C.3)."""

import functools
import itertools
from collections.abc import Mapping, Sequence

import numpy as np
from matplotlib import colormaps
from matplotlib.axes import Axes
from matplotlib.colors import to_hex
from matplotlib.figure import Figure

from galton.tasks import TASKS
from galton_experiments.analysis import Interval, against, compare, fit_curves, mean_band, rounded, within
from galton_experiments.analysis.plots import draw_series, finish, grid, over_steps
from galton_experiments.page import Claim
from galton_experiments.runs import Summary
from studies.paper.curves import counted
from studies.paper.figure import FigureStudy, figure
from studies.paper.measures import CLASSIFICATION, by_value, rate_spreads, spread
from studies.paper.prose import says
from studies.paper.sweeps import MAIN
from studies.paper.trained import Scale, Trained, optimum
from studies.paper.verdicts import A_TENTH, Found, by_task, claim, told_mean, unit

NAMES = {"learning_rate": "learning rate", "n_bins": "k", "eta": "η"}
_IN_WORDS = {"learning_rate": "the learning rate", "n_bins": "the number of bins", "eta": "η"}
_LABELS = {"gaussian": "the Gaussian", "hl-one-hot": "HL-1-Hot", "hl-gauss": "HL-Gauss"}
_ALIKE = 0.02
"""Curves that are nowhere further apart than this share of the panel's height lie upon one another."""


def marginals(summary: Summary, loss: str, field: str, metric: str) -> dict[float, Interval]:
    """For each value of a field, the mean curve over all settings of a loss that have it, `[L]`.

    The band is that of the mean over these very settings: trials are the sample, settings are strata.
    """
    curves = summary.curves(metric)
    groups: dict[float, list[np.ndarray]] = {}
    for setting in summary.study.settings:
        if setting["loss"] == loss:
            groups.setdefault(float(setting.record()[field]), []).append(curves[summary.rows(setting)])
    return {value: mean_band(group) for value, group in sorted(groups.items())}


def draw(grids: Mapping[str, Summary], loss: str, fields: tuple[str, ...]) -> Figure:
    """A row per field, a column per task; a cell says so where the sweep has one value alone."""
    found = {
        (field, task): marginals(summary, loss, field, "training_return")
        for field in fields
        for task, summary in grids.items()
    }
    rows = [field for field in fields if any(len(found[field, task]) > 1 for task in grids)]
    drawing, axes = grid(len(rows), len(grids))
    looks = {field: _looks([[*found[field, task]] for task in grids]) for field in rows}
    for i, (task, summary) in enumerate(grids.items()):
        column = dict(zip(rows, axes[i :: len(grids)], strict=True))
        varied = {field: panel for field, panel in column.items() if len(found[field, task]) > 1}
        for field in column.keys() - varied:
            _tell_missing(column[field], NAMES[field], [*found[field, task]])
        levels = [best for best in [optimum(task)] if best is not None]
        for field, panel in varied.items():
            for value, interval in found[field, task].items():
                draw_series(panel, summary.steps, interval, f"{NAMES[field]} {value:g}", *looks[field][value])
            fit_curves(panel, [curve for of in varied for curve in found[of, task].values()], levels)
            over_steps(panel, float(summary.steps[-1]))
            _tell_equal(panel, found[field, task], NAMES[field])
            is_last = field == [*varied][-1]
            panel.tick_params(labelbottom=is_last)
            panel.set_xlabel("environment steps" if is_last else "")
        axes[i].set_title(f"{TASKS[task].title}\n{counted(summary, loss)}", fontsize=7)
    for panel, field in zip(axes[:: len(grids)], rows, strict=True):
        panel.set_ylabel(f"by {NAMES[field]}\ntraining return")
    finish(drawing, axes, [f"{NAMES[field]} {value:g}" for field in rows for value in sorted(looks[field])])
    return drawing


def _tell_missing(axes: Axes, name: str, values: Sequence[float]) -> None:
    """Say in an empty cell which value there is alone."""
    axes.set_axis_off()
    told = f"{name} {values[0]:g}\nalone" if values else "not trained"
    axes.text(0.5, 0.5, told, transform=axes.transAxes, ha="center", va="center", fontsize=8, color="#444444")


_STYLES = ("-", "--", "-.", ":")


def _looks(values_of: Sequence[Sequence[float]]) -> dict[float, tuple[str, str]]:
    """A colour, dark to light, and a line style for each value: those of tasks that share none begin anew."""
    scales: list[set[float]] = []
    for values in map(set, values_of):
        shared = [scale for scale in scales if scale & values]
        scales = [scale for scale in scales if scale not in shared] + [values.union(*shared)]
    found: dict[float, tuple[str, str]] = {}
    for scale in scales:
        shades = map(to_hex, colormaps["viridis"](np.linspace(0, 0.78, len(scale))))  # dark enough for white paper
        found |= dict(zip(sorted(scale), zip(shades, itertools.cycle(_STYLES), strict=False), strict=True))
    return found


def _tell_equal(axes: Axes, curves: Mapping[float, Interval], name: str) -> None:
    """Name the values whose curves lie upon one another, of which a reader sees but one."""
    to_shares = axes.get_yaxis_transform() - axes.transAxes
    shown = {
        value: to_shares.transform(np.stack([np.linspace(0, 1, np.size(curve.mean)), curve.mean], axis=1))
        for value, curve in curves.items()
    }
    groups: list[list[float]] = []
    for value, curve in shown.items():
        apart = np.abs(curve - shown[groups[-1][0]]) if groups else np.array([np.nan])
        alike = not np.isnan(apart).all() and np.nanmax(apart) < _ALIKE
        groups = [*groups[:-1], [*groups[-1], value]] if alike else [*groups, [value]]
    told = "\n".join(f"{name} {group[0]:g}–{group[-1]:g} coincide" for group in groups if len(group) > 1)
    x, y = np.concatenate([*shown.values()]).T
    corners = {
        (0.98, 0.04, "right", "bottom"): (x > 0.4) & (y < 0.2),
        (0.04, 0.98, "left", "top"): (x < 0.6) & (y > 0.8),
        (0.98, 0.5, "right", "center"): (x > 0.4) & (np.abs(y - 0.5) < 0.1),
    }
    right, up, across, along = min(corners, key=lambda corner: int(corners[corner].sum()))
    axes.text(right, up, told, transform=axes.transAxes, ha=across, va=along, fontsize=6.5, color="#444444")


def sensitive(trained: Trained, loss: str, field: str, much: bool = True) -> Claim:
    """App. C.3: a field moves the mean final return by more, or less, than a tenth of the way from rest to the best."""

    def judge(task: str, scale: Scale) -> dict[str, Found]:
        moved = spread(trained.whole_grids[task], loss, field, scale)
        if moved is None:
            return {}
        found = against(moved, A_TENTH)
        return {"": unit(found if much else -found, told_mean(moved))}

    what = f"{_LABELS[loss][0].upper()}{_LABELS[loss][1:]} is {'sensitive' if much else 'robust'} to {_IN_WORDS[field]}"
    return claim(*says("sensitive", what=what), by_task(trained, trained.whole_grids, judge))


def wide_targets(trained: Trained) -> Claim:
    """Judge what App. C.3 says of Figure 4: the widest targets of the grid do harm."""

    def judge(task: str, scale: Scale) -> dict[str, Found]:
        marginals = [*by_value(trained.whole_grids[task], "hl-gauss", "eta").values()]
        if len(marginals) < 2:
            return {}
        return {"": compare(scale.share(marginals[0]), scale.share(marginals[-1]))}

    return claim(*says("wide_targets"), by_task(trained, trained.whole_grids, judge))


def similar_bins(trained: Trained) -> Claim:
    """App. C.3: the number of bins matters as much for HL-1-Hot as for HL-Gauss, give or take a tenth."""

    def judge(task: str, scale: Scale) -> dict[str, Found]:
        ours, theirs = (spread(trained.whole_grids[task], loss, "n_bins", scale) for loss in CLASSIFICATION)
        if ours is None or theirs is None:
            return {}
        gap = rounded(compare(ours, theirs).difference)
        return {"": unit(within(ours, theirs, A_TENTH), gap)}

    return claim(*says("similar_bins"), by_task(trained, trained.whole_grids, judge))


def also_sensitive(trained: Trained) -> Claim:
    """App. C.3: the learning rate matters for the other losses too."""

    def judge(task: str, scale: Scale) -> dict[str, Found]:
        pairs = rate_spreads(trained.whole_grids[task], ("gaussian", "hl-one-hot"), "hl-gauss", scale)
        return {name: compare(ours, theirs) for name, (ours, theirs) in pairs.items()}

    return claim(*says("also_sensitive"), by_task(trained, trained.whole_grids, judge), unless_contrary=True)


def _figure(number: int, loss: str, *fields: str) -> FigureStudy:
    words = {"loss": _LABELS[loss], "names": ", ".join(NAMES[field] for field in fields)}
    draw_it = functools.partial(_draw, loss=loss, fields=fields)
    return figure("sensitivity", draw_it, (*MAIN.values(),), number=number, filled=words)


def _draw(trained: Trained, loss: str, fields: tuple[str, ...]) -> Figure:
    return draw(trained.grids, loss, fields)


HL_GAUSS = _figure(4, "hl-gauss", "learning_rate", "n_bins", "eta")
HL_ONE_HOT = _figure(5, "hl-one-hot", "learning_rate", "n_bins")
GAUSSIAN = _figure(6, "gaussian", "learning_rate")
