"""The second path, part 2: intervals from scipy, exact rank tests by their generating functions, Holm, verdicts."""

import math
import warnings
from typing import NamedTuple

import numpy as np
from scipy import stats


class Found(NamedTuple):
    """One decision: its name, the numbers that the page prints, p, and which way it points."""

    name: str
    numbers: tuple
    """Numbers as printed: floats, or (mean, half of the interval)."""
    p: float
    sign: int
    null: str = ""


class Judged(NamedTuple):
    """A claim: what became of it, of each decision, and their adjusted p."""

    verdict: str
    count: tuple | None
    marks: list
    adjusted: list
    found: list


def above(a, b):
    """P(X > Y) + ½ P(X = Y)."""
    return float(np.mean([(x > y) + 0.5 * (x == y) for x in a for y in b]))


def difference(a, b, paired=False):
    """The mean difference and half of its 95% interval, Student's for pairs, else Welch's."""
    if np.ptp(a - b if paired else [*(a - a[0]), *(b - b[0])]) == 0:
        return float(a.mean() - b.mean()), 0.0
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", RuntimeWarning)  # that one of both has hardly any variance
        test = stats.ttest_rel(a, b) if paired else stats.ttest_ind(a, b, equal_var=False)
    low, high = test.confidence_interval(0.95)
    return float(a.mean() - b.mean()), float(high - low) / 2


def mean_of(a):
    """The mean and half of its 95% interval."""
    return difference(a, np.zeros(len(a)), paired=True)


def two_sided(weights, observed):
    """Twice the smaller tail, from what was observed on, of a distribution on 0, 1, 2, ..."""
    weights = weights / weights.sum()
    return float(min(1.0, 2 * min(weights[: observed + 1].sum(), weights[observed:].sum())))


def circle(n):
    """The n-th roots of 1: a polynomial of a lower degree is what its values there are the transform of."""
    return np.exp(2j * np.pi * np.arange(n) / n)


def rank_sum(a, b):
    """Mann and Whitney's two-sided p: exact up to 50 runs, ties included, else the normal approximation."""
    both = np.concatenate([a, b])
    if np.ptp(both) == 0:
        return 1.0
    if len(both) > 50:
        return float(stats.mannwhitneyu(a, b, method="asymptotic").pvalue)
    ranks = np.round(2 * stats.rankdata(both)).astype(int)
    sums, sizes = circle(ranks.sum() + 1), circle(len(both) + 1)
    values = np.ones((len(sizes), len(sums)), complex)
    for rank in ranks:  # Π (1 + size · sum^rank) counts the subsets by their size and the sum of their ranks
        values *= 1 + sizes[:, None] * sums[None, :] ** int(rank)
    of_size = np.fft.fft(values, axis=0)[len(a)] / len(sizes)
    return two_sided(np.round(np.fft.fft(of_size).real / len(sums)).clip(0), int(ranks[: len(a)].sum()))


def paired_rank_sum(a, b):
    """The two-sided p of P(X > Y) if the two of any pair may be exchanged: exact up to 50, ties included, else normal.

    Counted in wins: a pair that is exchanged moves the number of pairs of runs that the first wins.
    """
    wins = lambda x, y: int(sum(np.sign(x - other).sum() for other in y))  # noqa: E731
    moves = [wins(a[[i]], np.append(a, b)) - wins(b[[i]], np.append(a, b)) for i in range(len(a))]
    kept = np.array([move for move in moves if move], int)
    if not len(kept):
        return 1.0
    if len(kept) > 50:
        return float(2 * stats.norm.sf(abs(kept.sum()) / np.linalg.norm(kept)))
    sums = circle(abs(kept).sum() + 1)
    values = np.prod([1 + sums ** int(size) for size in abs(kept)], axis=0)
    return two_sided(np.round(np.fft.fft(values).real / len(sums)).clip(0), int(kept[kept > 0].sum()))


def are_few(a, b):
    """Say whether no order of so many runs has a p below 0.05."""
    return 2 / math.comb(len(a) + len(b), len(a)) >= 0.05


def compared(name, a, b, paired=False):
    """A decision on whether the first of two samples is larger: clear where ranks say so and means agree."""
    p = math.nan if are_few(a, b) else paired_rank_sum(a, b) if paired and len(a) >= 8 else rank_sum(a, b)
    gap, share = difference(a, b, paired), above(a, b)
    sign = np.sign(gap[0]) if np.sign(gap[0]) == np.sign(share - 0.5) else 0
    return Found(name, (gap, share), p, int(sign))


def against(name, values, level, shown):
    """A decision on whether the mean of a sample is above a level, by Student's t test."""
    p = float(stats.ttest_1samp(values, level).pvalue) if len(values) > 2 else math.nan
    share = above(values, [level])
    sign = np.sign(values.mean() - level) if np.sign(values.mean() - level) == np.sign(share - 0.5) else 0
    return Found(name, shown, p, int(sign))


def alike(name, a, b, margin, paired, shown):
    """A decision on whether means differ by less than a margin: the t test at its nearer end."""
    if are_few(a, b):
        return Found(name, shown, math.nan, 0)
    tests = [
        stats.ttest_1samp(a - b, end) if paired else stats.ttest_ind(a - end, b, equal_var=False)
        for end in (-margin, margin)
    ]
    size = abs(a.mean() - b.mean())
    return Found(name, shown, float(max(test.pvalue for test in tests)), 1 if size < margin else -1)


def null(name, why):
    """A task that is not judged."""
    return Found(name, (), math.nan, 0, why)


def holm(p):
    """Adjusted p values, by Holm's definition: the largest of (number of those not smaller) × p so far."""
    known = sorted(i for i, each in enumerate(p) if not math.isnan(each))
    adjusted = list(p)
    for i in known:
        before = [j for j in known if (p[j], j) <= (p[i], i)]
        steps = [(len(known) - sum((p[k], k) < (p[j], j) for k in known)) * p[j] for j in before]
        adjusted[i] = min(1.0, max(steps))
    return adjusted


def marks_of(found, unless_contrary=False):
    """Marks and adjusted p of the decisions of a claim."""
    adjusted, marks = holm([each.p for each in found]), []
    for each, p in zip(found, adjusted, strict=True):
        clear = each.sign if p < 0.05 else 0
        known = "✗" if clear < 0 else "✓" if clear > 0 or unless_contrary else "≈"
        marks.append("∅" if each.null else "?" if math.isnan(p) else known)
    return marks, adjusted


def judged(found, unless_contrary=False):
    """The verdict on a claim."""
    marks, adjusted = marks_of(found, unless_contrary)
    k, m, n = marks.count("✓"), marks.count("✗"), sum(mark in "✓✗≈" for mark in marks)
    if k == n > 0:
        verdict = "holds"
    elif k == m == 0:
        verdict = "not decidable here"
    else:
        verdict = "does not hold" if m > k else "holds in part"
    return Judged(verdict, (k, n) if n else None, marks, adjusted, list(found))
