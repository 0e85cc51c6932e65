"""Rank tests with exact p values, ties included: the permutation distribution of the sum of (mid)ranks."""

import math
from typing import NamedTuple

import numpy as np
from jaxtyping import Float
from scipy import stats

_EXACT = 50
"""Up to so many runs in all p is exact; beyond, the normal approximation with ties is as good."""


class RankTest(NamedTuple):
    """What a two-sided test by ranks says of two samples, or of their differences."""

    p: float
    """The chance of ranks at least as one-sided if neither tends to be larger; NaN where a sample is empty."""
    side: int
    """Which one the ranks say is larger: 1 the first, −1 the second, 0 neither."""


_NOTHING = RankTest(math.nan, 0)


def rank_sum(a: Float[np.ndarray, " n"], b: Float[np.ndarray, " m"]) -> RankTest:
    """Mann and Whitney's test that neither of two independent samples tends to be larger."""
    both = np.concatenate([a, b])
    if not len(a) or not len(b):
        return _NOTHING
    if (both == both[0]).all():
        return RankTest(1.0, 0)
    ranks = _doubled_ranks(both)
    observed = int(ranks[: len(a)].sum())
    side = int(np.sign(observed - len(a) * (len(both) + 1)))
    if len(both) > _EXACT:
        return RankTest(float(stats.mannwhitneyu(a, b, method="asymptotic").pvalue), side)
    return RankTest(_two_sided(_subsets(ranks)[len(a)], observed), side)


def signed_rank(differences: Float[np.ndarray, " n"]) -> RankTest:
    """Wilcoxon's test that differences are as likely positive as negative; zeros are left out."""
    if not len(differences):
        return _NOTHING
    differences = differences[differences != 0]
    if not len(differences):
        return RankTest(1.0, 0)
    ranks = _doubled_ranks(np.abs(differences))
    observed = int(ranks[differences > 0].sum())
    side = int(np.sign(2 * observed - ranks.sum()))
    if len(differences) > _EXACT:
        return RankTest(float(stats.wilcoxon(differences, method="approx").pvalue), side)
    return RankTest(_two_sided(_sums(ranks), observed), side)


def least_rank_sum_p(n: int, m: int) -> float:
    """The smallest p that `rank_sum` can have with so many runs on the two sides: all of one above all others."""
    return min(1.0, 2 / math.comb(n + m, n))


def least_signed_rank_p(n: int) -> float:
    """The smallest p that `signed_rank` can have with so many differences: all of one sign."""
    return min(1.0, 2 / 2**n)


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
