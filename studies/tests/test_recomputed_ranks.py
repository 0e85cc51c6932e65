"""What the second path takes from scipy or works out, by enumeration and in closed form."""

import itertools
import math

import numpy as np
import pytest
from scipy import stats

from galton.envs.lqr import LQR

from .recomputed.ranks import alike, compared, difference, holm, judged, paired_rank_sum, rank_sum
from .recomputed.runs import cost_to_go, lqr


def tails(values, observed):
    """Twice the smaller share of values on either side of one of them."""
    values = np.array([*values])
    return min(1.0, 2 * min((values <= observed + 1e-9).mean(), (values >= observed - 1e-9).mean()))


@pytest.mark.parametrize("step", [0.37, 1.0], ids=["no ties", "ties"])
def test_pairs_of_six_by_all_sixty_four_exchanges(step):
    first, second = np.array([3.0, 1, 4, 1.5, 5, 9]), np.array([2.0, 6, 5, 3, 5.5, 8]) // step * step
    signs = [np.array(of) for of in itertools.product([False, True], repeat=6)]
    pairs = [(np.where(of, second, first), np.where(of, first, second)) for of in signs]
    shares = [np.mean([(x > y) + 0.5 * (x == y) for x in a for y in b]) for a, b in pairs]
    for (a, b), share in zip(pairs, shares, strict=True):
        assert paired_rank_sum(a, b) == pytest.approx(tails(shares, share))
    assert paired_rank_sum(np.arange(6.0) + 0.5, np.arange(6.0)) == pytest.approx(2 / 64)
    assert paired_rank_sum(first, first) == 1


@pytest.mark.parametrize("values", [range(10), [0, 0, 1, 1, 1, 2, 3, 3, 4, 5]], ids=["no ties", "ties"])
def test_rank_sums_of_five_and_five_by_all_252_choices(values):
    values = np.array(values, float)
    ranks, choices = stats.rankdata(values), list(itertools.combinations(range(10), 5))
    sums = [ranks[[*chosen]].sum() for chosen in choices]
    for chosen, observed in zip(choices, sums, strict=True):
        a, b = values[[*chosen]], np.delete(values, [*chosen])
        assert rank_sum(a, b) == pytest.approx(tails(sums, observed))
        if len({*values}) == 10:
            assert rank_sum(a, b) == pytest.approx(stats.mannwhitneyu(a, b, method="exact").pvalue)
    assert rank_sum(values[:5], values[5:] + 5) == pytest.approx(2 / 252)


def test_the_largest_samples_that_are_exact_are():
    """Twenty-five against twenty-five, all above: one order of C(50, 25), on either side."""
    a, b = np.arange(25.0) + 30, np.arange(25.0)
    assert rank_sum(a, b) == pytest.approx(2 / math.comb(50, 25), rel=1e-6)
    rng = np.random.default_rng(0)
    a, b = rng.normal(size=(2, 25))
    assert rank_sum(a, b) == pytest.approx(stats.mannwhitneyu(a, b, method="exact").pvalue)


def test_intervals_by_hand():
    """Pairs 1, 2, 3 apart: mean 2, s = 1, t₀.₉₇₅ of 2 degrees of freedom 4.3027; unpaired, Welch's of 4."""
    a, b = np.array([2.0, 4.0, 6.0]), np.array([1.0, 2.0, 3.0])
    assert difference(a, b, paired=True) == pytest.approx((2.0, 4.3027 / 3**0.5), abs=1e-4)
    error, freedom = (5 / 3) ** 0.5, (5 / 3) ** 2 / ((4 / 3) ** 2 / 2 + (1 / 3) ** 2 / 2)
    assert difference(a, b) == pytest.approx((2.0, stats.t.ppf(0.975, freedom) * error))


def test_two_t_tests_by_hand():
    """Differences of mean 0 and s.e. ½ are 2 s.e. from a margin of 1: p = 2 P(t₃ > 2)."""
    a = np.array([0.5, 0.5, -0.5, -0.5]) * 3**0.5
    found = alike("", np.array([*a, *a]), np.zeros(8), 1.0, True, ())
    error = np.std([*a, *a], ddof=1) / 8**0.5
    assert (found.p, found.sign) == (pytest.approx(2 * stats.t.sf(1 / error, 7)), 1)
    assert alike("", np.array([*a, *a]) + 3, np.zeros(8), 1.0, True, ()).sign == -1


def test_holm_by_hand():
    assert holm([0.01, 0.04, math.nan, 0.03]) == pytest.approx([0.03, 0.06, math.nan, 0.06], nan_ok=True)
    assert holm([0.6, 0.6]) == [1.0, 1.0]


def test_a_mean_against_its_ranks_is_not_clear():
    """Nineteen of twenty runs are a little above, and one is far below."""
    a, b = np.array([*np.arange(19) + 100.0, -1e6]), np.arange(20.0)
    found = judged([compared("", a, b)])
    assert found.adjusted[0] < 1e-6
    assert found.marks == ["≈"]


@pytest.mark.parametrize(
    "given", [{}, {"R": ((0.1, 0.0), (0.0, 0.1))}, {"A": ((1.02, 0.0), (0.0, 1.02))}, {"max_episode_steps": 200}]
)
def test_the_lqr_by_least_squares_is_that_by_riccati(given):
    env = LQR(**given)
    assert lqr(given) == pytest.approx((max(env.rest_return, env.random_return), env.optimal_return))


def test_a_horizon_of_two_by_hand():
    """x costs 1, and then u² + (1 + u / 10)² is at least 1 / 1.01."""
    assert cost_to_go(2, 1.0, 1.0) == pytest.approx(1 + 1 / 1.01)
