import itertools

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy import stats

from galton.analysis.ranks import least_rank_sum_p, least_signed_rank_p, rank_sum, signed_rank

FEW = st.lists(st.sampled_from([-1.0, 0.0, 0.5, 2.0, 2.5, 7.0]), min_size=1, max_size=5)


def tails(values, observed):
    """Twice the smaller tail of equally likely values that begins at the observed one."""
    values = np.array(values)
    return min(1.0, 2 * min((values <= observed).mean(), (values >= observed).mean()))


@settings(max_examples=60)
@given(a=FEW, b=FEW)
def test_the_rank_sum_is_compared_with_those_of_every_other_split(a, b):
    ranks = stats.rankdata(a + b)
    sums = [sum(split) for split in itertools.combinations(ranks, len(a))]
    assert rank_sum(np.array(a), np.array(b)).p == pytest.approx(tails(sums, ranks[: len(a)].sum()))


@settings(max_examples=60)
@given(differences=FEW)
def test_the_signed_ranks_are_compared_with_those_of_every_other_sign(differences):
    known = np.array([x for x in differences if x])
    ranks = stats.rankdata(np.abs(known))
    sums = [sum(r for r, plus in zip(ranks, signs, strict=True) if plus) for signs in signs_of(len(ranks))]
    expected = tails(sums, ranks[known > 0].sum()) if len(known) else 1.0
    assert signed_rank(np.array(differences)).p == pytest.approx(expected)


def signs_of(n):
    return itertools.product((False, True), repeat=n)


@pytest.mark.parametrize(("n", "m"), [(5, 5), (12, 7), (20, 20), (50, 50), (60, 3)])
def test_without_ties_p_is_scipys(n, m):
    rng = np.random.default_rng(n)
    a, b = rng.normal(0.4, 1, n), rng.normal(0, 2, m)
    scipys = stats.mannwhitneyu(a, b, method="exact" if n + m <= 50 else "asymptotic").pvalue
    assert rank_sum(a, b).p == pytest.approx(scipys)
    assert signed_rank(a).p == pytest.approx(stats.wilcoxon(a, method="exact" if n <= 50 else "approx").pvalue)


def test_the_approximation_goes_on_where_the_exact_test_ends():
    rng = np.random.default_rng(0)
    a, b = rng.normal(0.5, 1, 25), rng.normal(0, 1, 25)
    assert rank_sum(a, b).p == pytest.approx(stats.mannwhitneyu(a, b, method="asymptotic").pvalue, rel=0.05)


def test_what_does_not_differ_has_p_1_and_nothing_has_none():
    assert rank_sum(np.ones(4), np.ones(30)) == rank_sum(np.ones(40), np.ones(40)) == signed_rank(np.zeros(9)) == (1, 0)
    for nothing in (rank_sum(np.ones(0), np.ones(3)), signed_rank(np.ones(0))):
        assert np.isnan(nothing.p)
        assert nothing.side == 0


@pytest.mark.parametrize(("n", "m"), [(3, 3), (4, 4), (5, 3), (1, 1)])
def test_the_least_p_is_that_of_samples_that_do_not_overlap(n, m):
    assert least_rank_sum_p(n, m) == pytest.approx(rank_sum(np.arange(n) + 100.0, np.arange(m) + 0.0).p)
    assert least_signed_rank_p(n) == pytest.approx(signed_rank(np.arange(n) + 1.0).p)


@pytest.mark.parametrize("n", [9, 40, 60])
def test_the_side_is_that_of_the_ranks(n):
    a, b = np.random.default_rng(n).normal(size=(2, n))
    assert rank_sum(a, b).side == np.sign(np.mean([np.sign(x - y) for x in a for y in b]))
    walsh = np.add.outer(a, a)[np.triu_indices(n)]  # the signed-rank sum counts the positive means of two
    assert signed_rank(a).side == np.sign((walsh > 0).sum() - (walsh < 0).sum())
    assert rank_sum(b, a).side == -rank_sum(a, b).side
    assert signed_rank(-a).side == -signed_rank(a).side
