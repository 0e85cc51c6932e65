"""Means with confidence intervals."""

from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Int
from scipy import stats

Numbers = np.float64 | Float[np.ndarray, "*rest"]


class Interval(NamedTuple):
    """A mean and its 95% confidence interval; arrays where the input had further axes."""

    mean: Numbers
    low: Numbers
    high: Numbers

    def __format__(self, spec: str) -> str:
        """Mean ± half the width, or the mean alone where the interval is not known."""
        if np.isnan(self.mean):
            return "—"
        mean, half = (format(float(x), spec).replace("-", "−") for x in (self.mean, self.high - self.mean))
        return mean if np.isnan(self.high) else f"{mean} ± {half.lstrip('+')}"


def mean_interval(samples: Float[np.ndarray, "n *rest"]) -> Interval:
    """Student's t interval of the mean over the first axis, NaN samples left out; NaN with fewer than two samples."""
    known = ~np.isnan(samples)
    n = known.sum(0)
    total = np.where(known, samples, 0.0).sum(0)
    mean = np.divide(total, n, out=np.full(total.shape, np.nan), where=n > 0)
    squares = np.where(known, (samples - mean) ** 2, 0.0).sum(0)
    variance = np.divide(squares, n - 1, out=np.full(total.shape, np.nan), where=n > 1)
    half = stats.t.ppf(0.975, np.maximum(n - 1, 1)) * np.sqrt(variance / np.maximum(n, 1))
    return Interval(mean, mean - half, mean + half)


def difference_interval(a: Float[np.ndarray, " n"], b: Float[np.ndarray, " m"]) -> Interval:
    """Welch's t interval of mean(a) − mean(b), samples independent, variances unequal; NaN samples are left out."""
    a, b = a[~np.isnan(a)], b[~np.isnan(b)]
    mean = np.float64(a.mean() - b.mean()) if len(a) and len(b) else np.float64(np.nan)
    if len(a) < 2 or len(b) < 2:
        return Interval(mean, np.float64(np.nan), np.float64(np.nan))
    var_a, var_b = a.var(ddof=1) / len(a), b.var(ddof=1) / len(b)
    if var_a + var_b == 0:
        return Interval(mean, mean, mean)
    freedom = (var_a + var_b) ** 2 / (var_a**2 / (len(a) - 1) + var_b**2 / (len(b) - 1))
    half = stats.t.ppf(0.975, freedom) * np.sqrt(var_a + var_b)
    return Interval(mean, mean - half, mean + half)


def fill_forward(curves: Float[np.ndarray, "R L"]) -> Float[np.ndarray, "R L"]:
    """Each NaN replaced by the last known value before it, where there is one."""
    known = ~np.isnan(curves)
    last = np.maximum.accumulate(np.where(known, np.arange(curves.shape[1]), 0), axis=1)
    return np.take_along_axis(curves, last, axis=1)


def fill_until(
    curves: Float[np.ndarray, "R L"], steps: Int[np.ndarray, " L"], diverged_at: Int[np.ndarray, " R"]
) -> Float[np.ndarray, "R L"]:
    """`fill_forward`, but NaN from the step where a run diverged; −1 for one that did not."""
    gone = (diverged_at >= 0)[:, None] & (steps >= diverged_at[:, None])
    return np.where(gone, np.nan, fill_forward(curves))
