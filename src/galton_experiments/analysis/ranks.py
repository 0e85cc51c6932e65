"""Rank tests with exact p values, ties included: the permutation distribution of the sum of (mid)ranks."""

import math

import numpy as np
from jaxtyping import Float
from scipy import stats

_EXACT = 50
"""Up to so many runs, or pairs, p is exact; beyond, the normal approximation with ties is as good."""


def rank_sum(a: Float[np.ndarray, " n"], b: Float[np.ndarray, " m"]) -> float:
    """Two-sided p of Mann and Whitney's test that P(X > Y) of two independent samples is ½; NaN where one is empty."""
    both = np.concatenate([a, b])
    if not len(a) or not len(b):
        return math.nan
    if (both == both[0]).all():
        return 1.0
    if len(both) > _EXACT:
        return float(stats.mannwhitneyu(a, b, method="asymptotic").pvalue)
    ranks = _doubled_ranks(both)
    return _two_sided(_subsets(ranks)[len(a)], int(ranks[: len(a)].sum()))


def paired_rank_sum(a: Float[np.ndarray, " n"], b: Float[np.ndarray, " n"]) -> float:
    """Two-sided p of the same for pairs, by exchanging the two of a pair: exact for up to fifty that differ.

    Unlike Wilcoxon's signed ranks it asks for P(X > Y), and a few pairs with huge differences weigh little: a run that
    fails has the lowest of all ranks, however far it falls. NaN where there are no pairs.
    """
    if not len(a):
        return math.nan
    ranks = _doubled_ranks(np.concatenate([a, b]))
    gaps = ranks[: len(a)] - ranks[len(a) :]
    gaps = gaps[gaps != 0]
    if not len(gaps):
        return 1.0
    if len(gaps) > _EXACT:
        return float(2 * stats.norm.sf(abs(gaps.sum()) / np.sqrt(np.square(gaps).sum())))
    return _two_sided(_sums(np.abs(gaps)), int(gaps[gaps > 0].sum()))


def least_rank_sum_p(n: int, m: int) -> float:
    """The smallest p that `rank_sum` can have with so many runs on the two sides: all of one above all others."""
    return min(1.0, 2 / math.comb(n + m, n))


def least_paired_p(n: int) -> float:
    """The smallest p that `paired_rank_sum` can have with so many pairs: the first of each is the larger one."""
    return min(1.0, 2 / 2**n)


def _doubled_ranks(values: Float[np.ndarray, " n"]) -> np.ndarray:
    """Twice the ranks, which are integers where ties share a mean rank."""
    return np.asarray(2 * stats.rankdata(values)).astype(np.int64)


def _subsets(ranks: np.ndarray) -> Float[np.ndarray, "_ _"]:
    """Count the subsets of the ranks, by their size and their sum (Streitberg and Röhmel's recursion)."""
    found = np.zeros((len(ranks) + 1, int(ranks.sum()) + 1))
    found[0, 0] = 1
    for rank in ranks:
        found[1:, rank:] += found[:-1, :-rank].copy()
    return found


def _sums(numbers: np.ndarray) -> Float[np.ndarray, " _"]:
    """Count the subsets of positive integers, by their sum."""
    found = np.zeros(int(numbers.sum()) + 1)
    found[0] = 1
    for number in numbers:
        found[number:] += found[:-number].copy()
    return found


def _two_sided(counts: Float[np.ndarray, " _"], observed: int) -> float:
    """Twice the smaller tail that begins at what was observed."""
    tails = counts[: observed + 1].sum(), counts[observed:].sum()
    return min(1.0, float(2 * min(tails) / counts.sum()))
