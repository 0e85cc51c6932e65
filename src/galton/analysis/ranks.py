"""Rank tests with exact p values, ties included: the permutation distribution of the sum of (mid)ranks."""

import math

import numpy as np
from jaxtyping import Float
from scipy import stats

_EXACT = 50
"""Up to so many runs in all p is exact; beyond, the normal approximation with ties is as good."""


def rank_sum_p(a: Float[np.ndarray, " n"], b: Float[np.ndarray, " m"]) -> float:
    """Two-sided p of Mann and Whitney's test that neither of two independent samples tends to be larger.

    NaN where either is empty.
    """
    both = np.concatenate([a, b])
    if not len(a) or not len(b):
        return math.nan
    if (both == both[0]).all():
        return 1.0
    if len(both) > _EXACT:
        return float(stats.mannwhitneyu(a, b, method="asymptotic").pvalue)
    ranks = _doubled_ranks(both)
    return _two_sided(_subsets(ranks)[len(a)], int(ranks[: len(a)].sum()))


def signed_rank_p(differences: Float[np.ndarray, " n"]) -> float:
    """Two-sided p of Wilcoxon's test that differences are as likely positive as negative; zeros are left out.

    NaN where there are none.
    """
    if not len(differences):
        return math.nan
    differences = differences[differences != 0]
    if not len(differences):
        return 1.0
    if len(differences) > _EXACT:
        return float(stats.wilcoxon(differences, method="approx").pvalue)
    ranks = _doubled_ranks(np.abs(differences))
    return _two_sided(_sums(ranks), int(ranks[differences > 0].sum()))


def least_p(n: int, m: int) -> float:
    """The smallest p that `rank_sum_p` can have with so many runs on the two sides: all of one above all others."""
    return min(1.0, 2 / math.comb(n + m, n))


def _doubled_ranks(values: Float[np.ndarray, " n"]) -> np.ndarray:
    """Twice the ranks, which are integers where ties share a mean rank."""
    return np.asarray(2 * stats.rankdata(values)).astype(np.int64)


def _subsets(ranks: np.ndarray) -> Float[np.ndarray, "_ _"]:
    """How many subsets of the ranks there are, by their size and their sum (Streitberg and Röhmel's recursion)."""
    found = np.zeros((len(ranks) + 1, int(ranks.sum()) + 1))
    found[0, 0] = 1
    for rank in ranks:
        found[1:, rank:] += found[:-1, :-rank].copy()
    return found


def _sums(ranks: np.ndarray) -> Float[np.ndarray, " _"]:
    """How many subsets of the ranks there are, by their sum."""
    found = np.zeros(int(ranks.sum()) + 1)
    found[0] = 1
    for rank in ranks:
        found[rank:] += found[:-rank].copy()
    return found


def _two_sided(counts: Float[np.ndarray, " _"], observed: int) -> float:
    """Twice the smaller tail that begins at what was observed."""
    tails = counts[: observed + 1].sum(), counts[observed:].sum()
    return min(1.0, float(2 * min(tails) / counts.sum()))
