"""Means and, after Agarwal et al. (2021, "Statistical precipice"), robuster statistics, with confidence intervals."""

from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Int
from scipy import stats

from galton.errors import require, require_integer

Numbers = np.float64 | Float[np.ndarray, "*rest"]

Tasks = Sequence[Float[np.ndarray, " _"]]
"""The scores of each task's runs, [R_m]: tasks may have unequal numbers of runs. A diverged run is NaN."""

Scores = Tasks | Float[np.ndarray, "_ _"]
"""The same; a matrix is [R, M], a row per run and a column per task."""

Statistic = Callable[[Tasks], float | Numbers]


class Interval(NamedTuple):
    """A mean, or another estimate, and its 95% confidence interval; arrays where there are several."""

    mean: Numbers
    low: Numbers
    high: Numbers

    def __format__(self, spec: str) -> str:
        """Mean ± half the width; mean [low, high] if that lies askew; the mean alone if the interval is not known."""
        if np.isnan(self.mean):
            return "—"
        below, above = float(self.mean) - float(self.low), float(self.high) - float(self.mean)
        mean, low, high, half = (format(float(x), spec).replace("-", "−") for x in (*self, (below + above) / 2))
        if np.isnan(below + above):
            return mean
        askew = abs(above - below) > 0.1 * (above + below)
        return f"{mean} [{low}, {high}]" if askew else f"{mean} ± {half.lstrip('+')}"


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


def stratified_bootstrap(scores: Scores, statistic: Statistic, n_resamples: int = 2000, seed: int = 0) -> Interval:
    """A statistic of the scores and its percentile interval, runs resampled within each task.

    The interval is NaN if a task has fewer than two runs, or if the statistic of a resample is NaN. Diverged runs reach
    the statistic as NaN.
    """
    require_integer("n_resamples", n_resamples, 1)
    require_integer("seed", seed, 0)
    tasks = _tasks(scores)
    estimate = np.asarray(statistic(tasks), np.float64)[()]
    if min(len(task) for task in tasks) < 2:
        return Interval(estimate, estimate * np.nan, estimate * np.nan)
    rng = np.random.default_rng(seed)
    resamples = ([task[rng.integers(len(task), size=len(task))] for task in tasks] for _ in range(n_resamples))
    estimates = np.array([statistic(resample) for resample in resamples])
    # Every method that interpolates makes NaN of two neighbours that are −∞.
    low, high = np.quantile(estimates, (0.025, 0.975), axis=0, method="inverted_cdf")
    return Interval(estimate, low, high)


def performance_profile(
    scores: Scores, taus: Float[np.ndarray, " T"], n_resamples: int = 2000, seed: int = 0
) -> Interval:
    """Share of runs that score above each tau, averaged over tasks, with a pointwise bootstrap band: [T] each.

    A diverged run is above no tau.
    """

    def profile(tasks: Tasks) -> Float[np.ndarray, " T"]:
        not_above = [np.searchsorted(np.sort(task), taus, "right") / len(task) for task in tasks]
        return np.asarray(1 - np.mean(not_above, axis=0))

    return stratified_bootstrap([_ranked(task) for task in _tasks(scores)], profile, n_resamples, seed)


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


def _tasks(scores: Scores) -> Tasks:
    """The scores as a list, task by task, once they are checked."""
    tasks = list(scores.T if isinstance(scores, np.ndarray) else scores)
    require(len(tasks) > 0, "scores has no tasks; give an array of scores for each")
    for i, task in enumerate(tasks):
        shape = np.shape(task)
        require(len(shape) == 1 and shape[0] > 0, f"scores[{i}] has shape {shape}; give the task's scores, one per run")
    return tasks


def _ranked(scores: Float[np.ndarray, " R"]) -> Float[np.ndarray, " R"]:
    """The scores with diverged runs below every other."""
    return np.where(np.isnan(scores), -np.inf, scores)
