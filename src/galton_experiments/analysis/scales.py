"""Axes of returns: fine near the best and coarse far from it, where what was learned early would flatten the rest."""

from collections.abc import Callable, Sequence
from typing import Any, Literal

import numpy as np
from jaxtyping import Float
from matplotlib.axes import Axes
from matplotlib.ticker import FixedFormatter, FixedLocator, NullLocator

from galton_experiments.analysis.statistics import Interval

_BETWEEN, _WIDE = {"x": 0.17, "y": 0.12}, 0.3
"""The least share of the axis between two ticks, and the gap that asks for a finer one between them."""
_SLIVERS = {0.1: 0.4, 0.35: 0.15}
"""A linear axis flattens if all but one share (a key) of the later half takes less than another (its value) of it."""

AXES = (
    "An axis whose numbers crowd is linear near the best return and logarithmic far from it, where early training "
    "would flatten the rest. It is fitted to the curves: where a band is wider than that, it goes on beyond it."
)
"""A sentence for the captions of figures with `fit_curves`."""

Scale = Callable[[Float[np.ndarray, "*n"]], Float[np.ndarray, "*n"]]


def fit_curves(axes: Axes, curves: Sequence[Interval], levels: Sequence[float] = ()) -> None:
    """The y axis by mean curves and levels, with room for bands above them but not for any single run.

    It is linear, unless the curves' later half would be a sliver of it: then it is fine near the best that is shown.
    """
    means = [mean[np.isfinite(mean)] for mean in (np.ravel(curve.mean) for curve in curves)]
    values = np.concatenate([*means, levels])
    if not len(values) or not np.ptp(values):
        return
    low, best, whole = values.min(), values.max(), np.ptp(values)
    late = np.concatenate([*(mean[len(mean) // 2 :] for mean in means), levels])
    bands = np.concatenate([[best], *(np.ravel(curve.high) for curve in curves)])
    top = np.nanmax(bands)
    flattened = any(best - np.quantile(late, below) < share * whole for below, share in _SLIVERS.items())
    if not flattened:
        axes.set_ylim(low - 0.05 * whole, max(best + 0.1 * whole, min(top, best + 0.4 * whole)))
        return
    unit = max(0.5 * (best - np.median(late)), whole / 100)
    from_best(axes, "y", best, unit, (low - 0.15 * whole, max(best + 0.6 * unit, min(top, best + 2 * unit))))


def from_best(axes: Axes, axis: Literal["x", "y"], best: float, unit: float, limits: tuple[float, float]) -> None:
    """Draw distances from the best value in proportion where they are small, and by their logarithm beyond that.

    Args:
        axes: what it is an axis of.
        axis: which of the two.
        best: the value about which the axis is finest.
        unit: the distance at which it turns from one to the other.
        limits: the values at the axis's ends.
    """

    def forward(values: Float[np.ndarray, "*n"]) -> Float[np.ndarray, "*n"]:
        away = np.asarray(values, np.float64) - best
        return np.asarray(np.sign(away) * np.log1p(np.abs(away) / unit))

    def backward(shares: Float[np.ndarray, "*n"]) -> Float[np.ndarray, "*n"]:
        shares = np.asarray(shares, np.float64)
        return np.asarray(best + np.sign(shares) * unit * np.expm1(np.abs(shares)))

    ticks = round_numbers(forward, limits, _BETWEEN[axis])
    drawn: Any = axes.xaxis if axis == "x" else axes.yaxis
    (axes.set_xscale if axis == "x" else axes.set_yscale)("function", functions=(forward, backward))
    (axes.set_xlim if axis == "x" else axes.set_ylim)(*limits)
    drawn.set_major_locator(FixedLocator(ticks))
    drawn.set_major_formatter(FixedFormatter([f"{tick:g}".replace("-", "−") for tick in ticks]))
    drawn.set_minor_locator(NullLocator())


def round_numbers(scale: Scale, limits: tuple[float, float], between: float) -> list[float]:
    """The roundest numbers between the limits that stand so far apart on this scale, until no gap is wide."""

    def place(values: Sequence[float]) -> Float[np.ndarray, "*n"]:
        low, high = scale(np.array(limits))
        return (scale(np.array(values)) - low) / (high - low)

    found: list[float] = []
    power = int(np.ceil(np.log10(limits[1] - limits[0])))
    for step in (digit * 10.0**exponent for exponent in range(power, power - 4, -1) for digit in (5, 2, 1)):
        if np.diff([0.0, *place(found), 1.0]).max() < _WIDE:
            break
        for multiple in range(int(np.ceil(limits[0] / step)), int(np.floor(limits[1] / step)) + 1):
            value = round(multiple * step, 10)
            if (np.abs(place(found) - place([value])) >= between).all():
                found = sorted([*found, value])
    return found
