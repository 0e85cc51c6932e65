"""Means and comparisons of two samples, with intervals and tests."""

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Int
from scipy import stats

from galton.errors import require
from galton_experiments.analysis.plain import rounded
from galton_experiments.analysis.ranks import least_paired_p, least_rank_sum_p, paired_rank_sum, rank_sum

Numbers = np.float64 | Float[np.ndarray, "*rest"]

Tasks = Sequence[Float[np.ndarray, " _"]]
"""The scores of each task's runs, [R_m]: tasks may have unequal numbers of runs. A diverged run is NaN."""


class Interval(NamedTuple):
    """A mean, or another estimate, and its 95% confidence interval; arrays where there are several."""

    mean: Numbers
    """The estimate that the interval is of."""
    low: Numbers
    """The lower end of its interval."""
    high: Numbers
    """The upper end of its interval."""

    def __format__(self, spec: str) -> str:
        """Mean ± half the width; mean [low, high] if that lies askew; the mean alone if the interval is not known."""
        if np.isnan(self.mean):
            return "—"
        below, above = float(self.mean) - float(self.low), float(self.high) - float(self.mean)
        mean, low, high, half = (format(rounded(x), spec).replace("-", "−") for x in (*self, (below + above) / 2))
        if np.isnan(below + above):
            return mean
        askew = abs(above - below) > 0.1 * (above + below) and not mean == low == high
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


class _Mean(NamedTuple):
    """An estimate of a mean, with its standard error and degrees of freedom; NaN where these are not known."""

    mean: float
    error: float
    freedom: float

    def interval(self) -> Interval:
        """The mean and its 95% interval by Student's t with these degrees of freedom."""
        half = stats.t.ppf(0.975, self.freedom) * self.error if self.error else self.error
        return Interval(*(np.float64(bound) for bound in (self.mean, self.mean - half, self.mean + half)))

    def p(self, level: float = 0.0) -> float:
        """Two-sided p of Student's test that the mean is that."""
        if self.error == 0:
            return float(self.mean == level)
        return float(2 * stats.t.sf(abs(self.mean - level) / self.error, self.freedom))


def _mean_difference(a: Float[np.ndarray, " n"], b: Float[np.ndarray, " m"], paired: bool) -> _Mean:
    """Of known samples: of the pairs' differences, or Welch's, variances unequal."""
    mean = float(a.mean() - b.mean()) if len(a) and len(b) else math.nan
    if min(len(a), len(b)) < 2:
        return _Mean(mean, math.nan, math.nan)
    if paired:
        return _Mean(mean, float(stats.sem(a - b)), len(a) - 1)
    var_a, var_b = a.var(ddof=1) / len(a), b.var(ddof=1) / len(b)
    if var_a + var_b == 0:
        return _Mean(mean, 0.0, math.nan)
    freedom = (var_a + var_b) ** 2 / (var_a**2 / (len(a) - 1) + var_b**2 / (len(b) - 1))
    return _Mean(mean, float(np.sqrt(var_a + var_b)), float(freedom))


def difference_interval(a: Float[np.ndarray, " n"], b: Float[np.ndarray, " m"]) -> Interval:
    """Welch's t interval of mean(a) − mean(b), samples independent, variances unequal; NaN samples are left out."""
    return _mean_difference(*_known(a, b, False), paired=False).interval()


class Comparison(NamedTuple):
    """A comparison sets the runs of one sample against those of another, or against a number."""

    difference: Interval
    """The mean difference and its 95% t interval."""
    p: float
    """Of a two-sided rank test that `above` is ½; NaN where so few runs can have no p below 0.05."""
    above: float
    """The chance that a run of the first is above one of the second, P(X > Y) + ½ P(X = Y)."""

    @property
    def direction(self) -> int:
        """1 where P(X > Y) and mean say that the first is larger, −1 where both say the second, 0 where they disagree.

        As they may where one run of twenty makes the mean: nothing is clear then.
        """
        side = np.sign(self.above - 0.5)
        return int(side) if side == np.sign(self.difference.mean) else 0

    def __neg__(self) -> "Comparison":
        """The second sample compared with the first."""
        mean, low, high = self.difference
        return Comparison(Interval(-mean, -high, -low), self.p, 1 - self.above)


ALPHA = 0.05
"""A difference is clear where p, adjusted for the other decisions of its claim, is below this."""
_PAIRS = 8
"""With fewer pairs no p of a paired rank test, 2/2ⁿ at least, survives Holm's adjustment for six decisions."""


def compare(
    a: Float[np.ndarray, " n"], b: Float[np.ndarray, " m"], paired: bool = False, worst: float = -math.inf
) -> Comparison:
    """Compare two samples, NaN left out.

    The interval is Welch's and the test Mann and Whitney's. Paired, a[i] and b[i] had the same seed: the interval is
    that of the mean difference, and the test exchanges the two of a pair; that of fewer than eight pairs ignores them,
    which is the more cautious. A diverged run is −∞: below all others by rank, and `worst` in the means.
    """
    a, b = _known(a, b, paired)
    p = paired_rank_sum(a, b) if paired and len(a) >= _PAIRS else rank_sum(a, b)
    p = math.nan if least_p(len(a), len(b), paired) >= ALPHA else p
    mean = _mean_difference(np.maximum(a, worst), np.maximum(b, worst), paired)
    return Comparison(mean.interval(), p, _share_above(a, b))


def least_p(n: int, m: int, paired: bool = False) -> float:
    """The smallest p that `compare` can have with so many runs that are known."""
    return least_paired_p(n) if paired and n >= _PAIRS else least_rank_sum_p(n, m)


def against(values: Float[np.ndarray, " n"], level: float = 0.0) -> Comparison:
    """Compare the mean of a sample with a number, NaN left out.

    Its p is that of Student's t test, since there is no second sample to rank with: the values should be means
    themselves. NaN of fewer than three.
    """
    values = values[~np.isnan(values)]
    mean = _mean_difference(values, np.full(len(values), level), paired=True)
    p = mean.p() if len(values) > 2 else math.nan
    return Comparison(mean.interval(), p, _share_above(values, np.full(1, level)))


def within(a: Float[np.ndarray, " n"], b: Float[np.ndarray, " m"], margin: float, paired: bool = False) -> Comparison:
    """Test whether the means of two samples differ by less than a margin: Schuirmann's two one-sided t tests.

    Its `difference` is what is left of the margin, negative where they differ by more; `above` is whether any is; `p`
    is that of the test at the nearer end of the margin, the weaker one, two-sided, which is twice as strict. NaN where
    `compare` has too few runs.
    """
    a, b = _known(a, b, paired)
    mean = _mean_difference(a, b, paired)
    _, low, high = bounds = mean.interval()
    size, *ends = (abs(float(bound)) for bound in bounds)
    least = 0.0 if low < 0 < high else min(ends)
    left = Interval(*(np.float64(margin - bound) for bound in (size, max(ends), least)))
    few = least_p(len(a), len(b), paired) >= ALPHA
    p = math.nan if few else max(mean.p(-margin), mean.p(margin))
    return Comparison(left, p, float(size < margin))


def _known(
    a: Float[np.ndarray, " n"], b: Float[np.ndarray, " m"], paired: bool
) -> tuple[Float[np.ndarray, " _"], Float[np.ndarray, " _"]]:
    """Both samples without NaN, pairs without those that lack either."""
    if not paired:
        return a[~np.isnan(a)], b[~np.isnan(b)]
    require(len(a) == len(b), f"a has {len(a)} runs and b {len(b)}; pairs need as many of both")
    whole = ~(np.isnan(a) | np.isnan(b))
    return a[whole], b[whole]


def holm(p: Sequence[float]) -> Float[np.ndarray, " n"]:
    """Holm's adjusted p values: below α, they reject with a chance of at most α of rejecting anything true.

    NaN stays NaN, and is not counted among the decisions.
    """
    given = np.asarray(p, np.float64)
    known = np.flatnonzero(~np.isnan(given))
    order = known[np.argsort(given[known], kind="stable")]
    adjusted = given.copy()
    adjusted[order] = np.minimum(np.maximum.accumulate(given[order] * np.arange(len(order), 0, -1)), 1.0)
    return adjusted


def pairs_above(a: Float[np.ndarray, "*#any n"], b: Float[np.ndarray, "*#any m"]) -> Float[np.ndarray, "*any n m"]:
    """Compare each of the first with each of the second: 1 if it is above, ½ for a tie, or 0."""
    ours, theirs = a[..., :, None], b[..., None, :]
    return np.asarray((ours > theirs) + 0.5 * (ours == theirs))


def _share_above(a: Float[np.ndarray, " n"], b: Float[np.ndarray, " m"]) -> float:
    return float(pairs_above(a, b).mean()) if len(a) and len(b) else math.nan


def fill_start(curves: Float[np.ndarray, "R L"]) -> Float[np.ndarray, "R L"]:
    """Each NaN before a run's first known value replaced by that: no episode had ended until then."""
    first = (~np.isnan(curves)).argmax(1)[:, None]
    before = np.arange(curves.shape[1]) < first
    return np.where(before, np.take_along_axis(curves, first, axis=1), curves)


def fill_until(
    curves: Float[np.ndarray, "R L"], steps: Int[np.ndarray, " L"], diverged_at: Int[np.ndarray, " R"]
) -> Float[np.ndarray, "R L"]:
    """Each NaN replaced by the last known value before it; NaN from the step where a run diverged, −1 if it did not."""
    last = np.maximum.accumulate(np.where(np.isnan(curves), 0, np.arange(curves.shape[1])), axis=1)
    gone = (diverged_at >= 0)[:, None] & (steps >= diverged_at[:, None])
    return np.where(gone, np.nan, np.take_along_axis(curves, last, axis=1))


def diverged_lowest(scores: Float[np.ndarray, "*any"]) -> Float[np.ndarray, "*any"]:
    """The scores with diverged runs, NaN, below every other."""
    return np.where(np.isnan(scores), -np.inf, scores)
