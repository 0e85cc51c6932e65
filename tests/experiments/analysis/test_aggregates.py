"""Numbers over many tasks, against rliable, scipy and plain counting."""

import importlib
import importlib.util
import itertools
import sys

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from rliable import metrics
from scipy import stats

from galton import UsageError
from galton_experiments.analysis.aggregates import best_of, improvement, interquartile_mean, percentiles

NAN = np.nan
SOME = st.sampled_from([-1.5, 0.0, 1.0, 2.5])


def three_tasks(n, shift=0.0):
    return np.random.default_rng(n).normal((shift, 1 + shift, 2 + shift), 1.0, (n, 3))


@pytest.fixture(scope="module")
def rliable():
    # It bootstraps with arch, of which only the bootstrap imports with pandas 3: leave the package's own module empty.
    sys.modules["arch"] = importlib.util.module_from_spec(importlib.util.find_spec("arch"))
    return importlib.import_module("rliable.library")


@given(arrays(float, (7, 3), elements=SOME), arrays(float, (9, 3), elements=SOME))
def test_both_are_rliables(x, y):
    assert interquartile_mean([*x.T], n_resamples=1).mean == pytest.approx(metrics.aggregate_iqm(x))
    assert improvement([*x.T], [*y.T], n_resamples=1).mean == pytest.approx(metrics.probability_of_improvement(x, y))


@pytest.mark.slow
def test_their_intervals_are_rliables(rliable):
    np.random.seed(0)  # noqa: NPY002 — rliable draws from NumPy's global generator
    x, y = three_tasks(12, 0.4), three_tasks(9)
    _, bounds = rliable.get_interval_estimates({0: x}, lambda x: np.array([metrics.aggregate_iqm(x)]), reps=1000)
    np.testing.assert_allclose(interquartile_mean([*x.T])[1:], bounds[0][:, 0], atol=0.08)
    both = {0: (x, y)}
    _, bounds = rliable.get_interval_estimates(
        both, lambda x, y: np.array([metrics.probability_of_improvement(x, y)]), reps=1000
    )
    np.testing.assert_allclose(improvement([*x.T], [*y.T])[1:], bounds[0][:, 0], atol=0.03)


def test_paired_runs_are_drawn_together():
    """Against drawing the pairs again by hand, where seeds make nearly all of the spread."""
    rng = np.random.default_rng(3)
    seeds = rng.normal(size=(2, 10))
    theirs = list(seeds)
    ours = [runs + 0.3 + 0.1 * rng.normal(size=10) for runs in seeds]
    found, apart = improvement(ours, theirs, paired=True), improvement(ours, theirs)
    drawn = []
    for _ in range(2000):
        picks = [rng.integers(10, size=10) for _ in ours]
        drawn.append(np.mean([np.mean(a[i][:, None] > b[i]) for a, b, i in zip(ours, theirs, picks, strict=True)]))
    about_the_mean = np.array(drawn) - np.mean(drawn) + found.mean
    np.testing.assert_allclose(found[1:], np.quantile(about_the_mean, (0.025, 0.975)), atol=0.01)
    assert found.mean == apart.mean
    assert found.low > 0.5 > apart.low
    with pytest.raises(UsageError, match="pairs need as many of both"):
        improvement([np.ones(3)], [np.ones(4)], paired=True)


@pytest.mark.parametrize("of_seed", [0.0, 0.9], ids=["nothing", "nearly all"])
def test_of_equal_methods_few_paired_intervals_leave_out_a_half(of_seed):
    """However much of the spread is the seeds'; five runs of three tasks. The interval lies about its mean."""
    rng = np.random.default_rng(5)
    found = []
    for _ in range(200):
        seeds = rng.normal(size=(3, 5)) * of_seed**0.5
        a, b = (list(seeds + rng.normal(size=(3, 5)) * (1 - of_seed) ** 0.5) for _ in range(2))
        found.append(improvement(a, b, n_resamples=300, paired=True))
    assert np.mean([not each.low <= 0.5 <= each.high for each in found]) < 0.1
    assert abs(np.mean([(each.low + each.high) / 2 - each.mean for each in found])) < 0.01


def test_a_diverged_run_is_below_all_others():
    tasks = [np.array([1.0, NAN, 3.0, 2.0]), np.array([0.0, 1.0, 2.0, 3.0])]
    pooled = [-np.inf, 0, 1, 1, 2, 2, 3, 3]
    assert interquartile_mean(tasks).mean == stats.trim_mean(pooled, 0.25) == 1.5
    assert improvement([np.array([NAN, NAN])], [np.array([-1e9, NAN])]).mean == 0.25  # a tie with the other that did
    assert percentiles(np.array([NAN, 0.0]), np.array([NAN, 0.0])).tolist() == [0.25, 0.75]


def test_one_run_of_a_task_or_fewer_than_five_of_all_give_no_interval():
    one, many = [np.array([1.0]), np.arange(9.0)], [np.array([1.0, 2.0]), np.arange(9.0)]
    two = np.array([1.0, 2.0])
    assert np.isnan(improvement([two, two], [two - 5, two - 5]).low)
    assert np.isfinite(improvement([two] * 3, [two - 5] * 3).low)
    for interval in (interquartile_mean(one), improvement(one, many), improvement(many, one)):
        assert np.isfinite(interval.mean)
        assert np.isnan(interval.low)


@given(arrays(float, 6, elements=SOME), arrays(float, 11, elements=SOME))
def test_a_percentile_is_the_share_below_and_half_of_what_is_equal(values, pool):
    counted = [(sum(p < v for p in pool) + 0.5 * sum(p == v for p in pool)) / 11 for v in values]
    np.testing.assert_allclose(percentiles(values, pool), counted)
    assert percentiles(pool, pool).mean() == pytest.approx(0.5)


@given(arrays(float, 6, elements=SOME), arrays(float, 6, elements=st.floats(-5, 5)))
def test_the_best_of_n_draws_is_the_mean_over_all_subsets(chosen_by, worth):
    for n in range(1, 7):
        subsets = [[*subset] for subset in itertools.combinations(range(6), n)]
        mean = np.mean([worth[subset[int(np.argmax(chosen_by[subset]))]] for subset in subsets])
        assert best_of(chosen_by, worth)[n - 1] == pytest.approx(mean)


def test_the_best_of_its_own_scores_rises_from_the_mean_to_the_maximum():
    scores = np.random.default_rng(0).normal(size=16)
    found = best_of(scores, scores)
    assert (found[0], found[-1]) == (pytest.approx(scores.mean()), scores.max())
    assert (np.diff(found) > 0).all()


def test_other_tasks_and_no_runs_are_refused():
    with pytest.raises(UsageError, match="ours has 1 tasks and theirs 2"):
        improvement([np.ones(3)], [np.ones(3), np.ones(3)])
    with pytest.raises(UsageError, match="pool is empty"):
        percentiles(np.ones(2), np.ones(0))
    with pytest.raises(UsageError, match="scores lacks a task's runs"):
        interquartile_mean([np.ones(3), np.ones(0)])


def test_an_interval_that_is_a_point_although_tasks_differ_is_written_by_task():
    """Every pair of a task says the same, so drawing runs again changes nothing."""
    high, low = np.array([3.0, 4.0, 5.0]), np.array([0.0, 1.0, 2.0])
    found = improvement([low, high, low], [high, low, high], paired=True)
    assert f"{found:.2f}" == "0, 1, 0 by task"
    assert found.mean == pytest.approx(1 / 3)
    assert np.isnan(found.low)
    alike = improvement([high, high], [low, low], paired=True)
    assert f"{alike:.2f}" == "1.00 ± 0.00"
