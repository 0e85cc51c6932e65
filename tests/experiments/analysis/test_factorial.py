"""A factorial data set's answers, against plain loops over all runs and rliable's definition."""

import itertools

import numpy as np
import pytest
from rliable import metrics

from galton import UsageError
from galton_experiments.analysis.factorial import factorial, halves

SOME = (0.0, 1.0, 0.125, 0.5, 0.75)


def share_above(ours, theirs):
    return np.mean([(a > b) + 0.5 * (a == b) for a in ours for b in theirs])


def counted(scores, tasks=None, draws=None, seeds=None, base=0):
    """All answers by loops; what is drawn again are lists: of tasks, of draws, and of seeds by split and task."""
    n_methods, n_draws, n_tasks, n_seeds = scores.shape
    tasks, draws = tasks or [*range(n_tasks)], sorted(draws or range(n_draws))
    quarter = max(1, n_draws // 4)
    found = {name: [[] for _ in range(n_methods)] for name in ("one_setting", "per_task", "top_quarter", "same_draw")}
    best = [[[] for _ in range(n_draws)] for _ in range(n_methods)]
    for split, (select, judge) in enumerate(halves(n_seeds)):
        for task in tasks:
            by, own, judges = [], [], []
            for method in range(n_methods):
                mean = np.array(
                    [
                        [scores[method, d, k][seeds[split][k][0] if seeds else select].mean() for k in range(n_tasks)]
                        for d in range(n_draws)
                    ]
                ).round(12)
                others = [k for k in tasks if k != task] or [k for k in range(n_tasks) if k != task]
                by.append(sorted(draws, key=lambda d: -mean[d, others].mean().round(12)))
                own.append(max(draws, key=lambda d: mean[d, task]))
                judges.append(
                    [scores[method, d, task][seeds[split][task][1] if seeds else judge] for d in range(n_draws)]
                )
            for method in range(n_methods):
                found["one_setting"][method].append(
                    share_above(judges[method][by[method][0]], judges[base][by[base][0]])
                )
                found["per_task"][method].append(share_above(judges[method][own[method]], judges[base][own[base]]))
                top = itertools.product(by[method][:quarter], by[base][:quarter])
                found["top_quarter"][method].append(
                    np.mean([share_above(judges[method][i], judges[base][j]) for i, j in top])
                )
                for n in range(1, n_draws + 1):
                    subsets = itertools.combinations(range(n_draws), n)
                    best[method][n - 1].append(np.mean([judges[method][by[method][s[0]]].mean() for s in subsets]))
    for method in range(n_methods):
        for task, draw in itertools.product(tasks, draws):
            again = seeds[-1][task] if seeds else [*range(n_seeds)]
            ours, theirs = (scores[m, draw, task][again] for m in (method, base))
            found["same_draw"][method].append(share_above(ours, theirs))
    return {name: np.mean(of, axis=1) for name, of in found.items()} | {"best_of": np.mean(best, axis=2)}


@pytest.mark.parametrize("n", [2, 3, 4, 5])
def test_halves_are_used_both_ways_and_each_seed_as_often(n):
    found = halves(n)
    for select, judge in found:
        assert sorted([*select, *judge]) == [*range(n)]
        assert (judge, select) in found
    assert len({sum(seed in select for select, _ in found) for seed in range(n)}) == 1


@pytest.mark.parametrize("n_seeds", [2, 3, 4])
@pytest.mark.parametrize("values", [SOME, SOME[:2]], ids=["few ties", "many"])
def test_the_answers_are_those_of_plain_loops(n_seeds, values):
    for seed in range(4):
        scores = np.random.default_rng(seed).choice(values, (2, 5, 3, n_seeds))
        found, wanted = factorial(scores, 1, n_resamples=1), counted(scores, base=1)
        for name, of in wanted.items():
            np.testing.assert_allclose(getattr(found, name).mean, of, err_msg=name)
        gain = wanted["best_of"] - wanted["best_of"][1]
        np.testing.assert_allclose(found.best_of_gain.mean, gain, atol=1e-12)
        for name in ("one_setting", "per_task", "top_quarter"):
            np.testing.assert_allclose(getattr(found, f"{name}_by_task").mean(1), wanted[name])


def test_with_eight_draws_two_are_the_best_quarter():
    scores = np.random.default_rng(0).normal(size=(3, 8, 4, 2))
    np.testing.assert_allclose(factorial(scores, n_resamples=1).top_quarter.mean, counted(scores)["top_quarter"])


def test_with_one_draw_all_are_rliables_probability_of_improvement():
    scores = np.random.default_rng(1).normal(size=(2, 1, 4, 5))
    found = factorial(scores, n_resamples=1)
    ours, theirs = (of[0].T for of in scores[::-1])
    assert found.same_draw.mean[1] == pytest.approx(metrics.probability_of_improvement(ours, theirs))


@pytest.mark.slow
def test_the_intervals_are_those_of_drawing_again_by_hand():
    rng = np.random.default_rng(2)
    scores = np.clip(
        rng.normal(0.5, 0.15, (2, 5, 4, 3)) + rng.normal(0, 0.1, (1, 5, 1, 1)) + [[[[0]]], [[[0.05]]]], 0, 1
    )
    found, again = factorial(scores, n_resamples=4000), []
    for _ in range(400):
        seeds = [[[list(rng.choice(half, len(half))) for half in split] for _ in range(4)] for split in halves(3)]
        seeds.append([list(rng.integers(3, size=3)) for _ in range(4)])
        again.append(counted(scores, list(rng.integers(4, size=4)), list(rng.integers(5, size=5)), seeds))
    for name in ("one_setting", "per_task", "top_quarter", "same_draw", "best_of"):
        mean = getattr(found, name).mean
        by_hand = np.array([each[name] for each in again])
        ends = np.clip(np.quantile(by_hand, (0.025, 0.975), axis=0) + mean - by_hand.mean(0), 0, 1)
        np.testing.assert_allclose(getattr(found, name)[1:], ends, atol=0.08, err_msg=name)


def test_a_method_beside_itself_is_level_and_one_that_always_wins_has_all():
    rng = np.random.default_rng(3)
    same = rng.uniform(size=(4, 3, 2)) / 2
    found = factorial(np.array([same, same, same + 0.5]), n_resamples=200)
    for name in ("one_setting", "per_task", "top_quarter", "same_draw"):
        mean, low, high = getattr(found, name)
        assert mean.tolist() == pytest.approx([0.5, 0.5, 1])
        assert [low[2], high[2]] == pytest.approx([1, 1])
    assert (found.best_of_gain.low[2] > 0).all()


def test_where_tasks_differ_the_interval_does_not_collapse():
    """Runs of 0, 1 and 0 by task say nothing by their seeds, and much by their tasks."""
    scores = np.full((2, 2, 3, 2), 0.5)
    scores[1] = np.array([0.0, 1.0, 0.0])[:, None]
    found = factorial(scores, n_resamples=2000)
    assert found.one_setting_by_task[1].tolist() == [0, 1, 0]
    assert found.one_setting.mean[1] == pytest.approx(1 / 3)
    assert found.one_setting.high[1] - found.one_setting.low[1] > 0.6


@pytest.mark.parametrize(
    ("shape", "words"),
    [((2, 3, 1, 2), "scores has 1 task; give two or more"), ((2, 3, 2, 1), "n_seeds is 1; give two or more")],
)
def test_one_task_or_seed_can_not_both_select_and_judge(shape, words):
    with pytest.raises(UsageError, match=words):
        factorial(np.zeros(shape))


def test_runs_that_are_not_ranked_are_refused():
    with pytest.raises(UsageError, match="scores has NaN"):
        factorial(np.full((2, 3, 2, 2), np.nan))
