import itertools

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy import stats

from galton_experiments.analysis.ranks import least_paired_p, least_rank_sum_p, paired_rank_sum, rank_sum

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
    assert rank_sum(np.array(a), np.array(b)) == pytest.approx(tails(sums, ranks[: len(a)].sum()))


@settings(max_examples=60)
@given(st.lists(st.tuples(*[st.sampled_from([-1.0, 0.0, 0.5, 2.0, 2.5, 7.0])] * 2), min_size=1, max_size=6))
def test_the_rank_sum_of_pairs_is_compared_with_those_where_pairs_are_exchanged(pairs):
    pairs = np.array(pairs)
    above = [np.sign(a[:, None] - b).sum() for a, b in (exchanged(pairs, which).T for which in choices(len(pairs)))]
    assert paired_rank_sum(*pairs.T) == pytest.approx(tails(above, above[0]))  # by P(X > Y), not by ranks


def choices(n):
    return itertools.product((False, True), repeat=n)


def exchanged(pairs, which):
    return np.where(np.array(which)[:, None], pairs[:, ::-1], pairs)


@pytest.mark.parametrize(("n", "m"), [(5, 5), (12, 7), (20, 20), (50, 50), (60, 3)])
def test_without_ties_p_is_scipys(n, m):
    rng = np.random.default_rng(n)
    a, b = rng.normal(0.4, 1, n), rng.normal(0, 2, m)
    scipys = stats.mannwhitneyu(a, b, method="exact" if n + m <= 50 else "asymptotic").pvalue
    assert rank_sum(a, b) == pytest.approx(scipys)


@pytest.mark.few
@pytest.mark.parametrize("n", [9, 12, 40, 60])
def test_pairs_are_exchanged_as_scipy_exchanges_them(n):
    a = np.random.default_rng(n).normal(0.4, 1, n)
    b = 0.5 * a + np.random.default_rng(n + 1).normal(0, 1, n)
    wins = lambda a, b: stats.mannwhitneyu(a, b).statistic  # noqa: E731
    found = stats.permutation_test((a, b), wins, permutation_type="samples", n_resamples=4_100, rng=0)
    error = 0 if n <= 12 else 4 * np.sqrt(found.pvalue / 4_100)  # up to 2¹² it tries them all
    assert paired_rank_sum(a, b) == pytest.approx(found.pvalue, abs=1e-12 + error)


def test_the_approximation_goes_on_where_the_exact_test_ends():
    rng = np.random.default_rng(0)
    a, b = rng.normal(0.5, 1, 25), rng.normal(0, 1, 25)
    assert rank_sum(a, b) == pytest.approx(stats.mannwhitneyu(a, b, method="asymptotic").pvalue, rel=0.05)
    a, b = rng.normal(0.3, 1, (2, 51)) * np.array([[1], [-1]])
    assert paired_rank_sum(a, b) == pytest.approx(paired_rank_sum(a[:50], b[:50]), rel=0.3)


def test_what_does_not_differ_has_p_1_and_nothing_has_none():
    assert rank_sum(np.ones(4), np.ones(30)) == rank_sum(np.ones(40), np.ones(40)) == 1
    assert paired_rank_sum(np.arange(9.0), np.arange(9.0)) == 1
    assert np.isnan(rank_sum(np.ones(0), np.ones(3)))
    assert np.isnan(paired_rank_sum(np.ones(0), np.ones(0)))


@pytest.mark.parametrize(("n", "m"), [(3, 3), (4, 4), (5, 3), (1, 1)])
def test_the_least_p_is_that_of_samples_that_do_not_overlap(n, m):
    assert least_rank_sum_p(n, m) == pytest.approx(rank_sum(np.arange(n) + 100.0, np.arange(m) + 0.0))
    assert least_paired_p(n) == pytest.approx(paired_rank_sum(np.arange(n) + 0.5, np.arange(n) + 0.0))


def test_a_run_that_fails_weighs_no_more_than_one_that_is_the_lowest():
    """Of 50 pairs 43 are won and 7 lost by far: by signed ranks a close call, by P(X > Y) not."""
    b = np.arange(50.0)
    a = np.where(b < 7, -1e6, b + 100)
    assert paired_rank_sum(a, b) == paired_rank_sum(np.where(b < 7, -1, b + 100), b) < 1e-6
    assert stats.wilcoxon(a - b).pvalue > 1e-4
