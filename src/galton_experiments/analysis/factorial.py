"""Methods are compared by a factorial data set: draws, tasks and seeds are the same for all, and all are random.

Scores are percentiles among all runs of a task, [methods, draws, tasks, seeds], so that tasks count alike. One half of
the seeds selects a draw and the other half judges it. The intervals draw tasks again, draws, which are common to all
methods and tasks, and the seeds of each task within their half: the bootstrap of crossed factors (Owen, 2007).
"""

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Int

from galton.errors import require
from galton_experiments.analysis.aggregates import chances_of_best
from galton_experiments.analysis.bands import RESAMPLES, times_drawn
from galton_experiments.analysis.statistics import Interval, pairs_above

Scores = Float[np.ndarray, "methods draws tasks seeds"]
_AT_ONCE = 500
"""Resamples that are in memory together."""


class Factorial(NamedTuple):
    """Each Interval of these results has a number for each method, and P is the chance of being above the baseline."""

    one_setting: Interval
    """P of the draw that each method selects on the other tasks, [methods], averaged over the task that is left out."""
    one_setting_by_task: Float[np.ndarray, "methods tasks"]
    """The same P on each task that is left out."""
    per_task: Interval
    """P of the draw that each method selects on the task itself, [methods]."""
    per_task_by_task: Float[np.ndarray, "methods tasks"]
    """The same P on each task."""
    top_quarter: Interval
    """P of the best quarter of each method's draws, selected on the other tasks, [methods]."""
    top_quarter_by_task: Float[np.ndarray, "methods tasks"]
    """The same P on each task that is left out."""
    same_draw: Interval
    """P where both methods have the same draw, averaged over all draws, [methods]; no draw is selected."""
    best_of: Interval
    """The mean score of the best of n = 1 … N draws, selected on the other tasks, [methods, draws]."""
    best_of_gain: Interval
    """The same less the baseline's, [methods, draws]."""


class _Again(NamedTuple):
    """Tasks and draws, drawn again B times."""

    tasks: Float[np.ndarray, "B tasks"]
    """The number of times that each task was drawn."""
    draws: Int[np.ndarray, "B draws"]
    """The draws that were drawn, in rising order."""


def halves(n_seeds: int) -> list[tuple[list[int], list[int]]]:
    """The seeds that select and those that judge, both ways: each seed is as often among the first as any other."""
    require(n_seeds > 1, f"n_seeds is {n_seeds}; give two or more, for those that select a draw must not judge it")
    found: dict[tuple[int, ...], None] = {}
    for first in range(n_seeds):
        half = {(first + i) % n_seeds for i in range(n_seeds // 2)}
        for chosen in (half, {*range(n_seeds)} - half):
            found[tuple(sorted(chosen))] = None
    return [([*half], [seed for seed in range(n_seeds) if seed not in half]) for half in found]


def factorial(scores: Scores, baseline: int = 0, n_resamples: int = RESAMPLES, seed: int = 0) -> Factorial:
    """Compare methods by scores, with 95% intervals: the resamples' percentiles, moved by how far their mean lies off.

    Args:
        scores: percentiles, from 0 to 1; none may be NaN.
        baseline: the place of the method that all others are compared with.
        n_resamples: how often tasks, draws and seeds are drawn again.
        seed: of these draws.
    """
    _, n_draws, n_tasks, _ = scores.shape
    require(n_tasks > 1, f"scores has {n_tasks} task; give two or more, for one is left out")
    require(not np.isnan(scores).any(), "scores has NaN; rank diverged runs below all others")
    once = _Again(np.ones((1, n_tasks)), np.arange(n_draws)[None])
    found = _found(scores, baseline, once, None)
    parts = [_found(scores, baseline, again, rng) for rng, again in _drawn_again(scores.shape, n_resamples, seed)]
    several = {name: np.concatenate([part[name] for part in parts]) for name in found if "by_task" not in name}
    intervals = {name: _interval(found[name][0], of, name != "best_of_gain") for name, of in several.items()}
    by_task = {name: of[0] for name, of in found.items() if name not in intervals}
    return Factorial(**{**intervals, **by_task})


def _drawn_again(shape: tuple[int, ...], n_resamples: int, seed: int) -> Iterator[tuple[np.random.Generator, _Again]]:
    """All resamples, some at a time, each time with what their seeds are to be drawn with."""
    rng = np.random.default_rng(seed)
    for first in range(0, n_resamples, _AT_ONCE):
        n = min(_AT_ONCE, n_resamples - first)
        draws = np.sort(rng.integers(shape[1], size=(n, shape[1])), axis=1)
        yield rng, _Again(times_drawn(rng, shape[2], n).astype(float), draws)


def _found(
    scores: Scores, base: int, again: _Again, rng: np.random.Generator | None
) -> dict[str, Float[np.ndarray, "B *rest"]]:
    """Each number of Factorial in each resample; without a generator all seeds count once."""
    splits = [_of_split(scores, base, again, rng, *split) for split in halves(scores.shape[3])]
    found = {name: np.mean([split[name] for split in splits], axis=0) for name in splits[0]}
    share = again.tasks / scores.shape[2]
    for name in ("one_setting", "per_task", "top_quarter"):
        found[name] = np.einsum("bmk,bk->bm", found[f"{name}_by_task"], share)
    weights = _weights(rng, len(share), scores.shape[2], scores.shape[3])
    counts = (again.draws[:, :, None] == np.arange(scores.shape[1])).mean(1)
    same = pairs_above(scores, scores[base])
    found["same_draw"] = np.einsum("mdkst,bd,bk,bks,bkt->bm", same, counts, share, weights, weights, optimize=True)
    return found


def _of_split(
    scores: Scores, base: int, again: _Again, rng: np.random.Generator | None, select: list[int], judge: list[int]
) -> dict[str, Float[np.ndarray, "B *rest"]]:
    """Those numbers for which some seeds select and others judge, with P by the task that judges."""
    _, n_draws, n_tasks, _ = scores.shape
    n, counts = len(again.tasks), again.tasks
    own = np.einsum("mdks,bks->bmdk", scores[..., select], _weights(rng, n, n_tasks, len(select)), optimize=True)
    weights, judged = _weights(rng, n, n_tasks, len(judge)), scores[..., judge]
    summed = np.einsum("bmdk,bk->bmd", own, counts)[..., None] - own * counts[:, None, None]
    left = (counts.sum(1, keepdims=True) - counts)[:, None, None]
    rest = (own.sum(3, keepdims=True) - own) / (n_tasks - 1)
    others = np.where(left > 0, summed / np.maximum(left, 1), rest)  # where no other task was drawn all others select
    best, best_here = _ranked(others, again.draws), _ranked(own, again.draws)
    ranks = range(max(1, n_draws // 4))
    above = {(i, j): _above(judged, base, best[..., i], best[:, base, :, j], weights) for i in ranks for j in ranks}
    worth = np.take_along_axis(np.einsum("mdks,bks->bmkd", judged, weights, optimize=True), best, 3)
    best_of = np.einsum("nd,bmkd,bk->bmn", chances_of_best(n_draws), worth, counts / n_tasks, optimize=True)
    return {
        "one_setting_by_task": above[0, 0],
        "per_task_by_task": _above(judged, base, best_here[..., 0], best_here[:, base, :, 0], weights),
        "top_quarter_by_task": np.mean([*above.values()], axis=0),
        "best_of": best_of,
        "best_of_gain": best_of - best_of[:, [base]],
    }


def _weights(rng: np.random.Generator | None, n: int, n_tasks: int, n_seeds: int) -> Float[np.ndarray, "B tasks seeds"]:
    """The share that each seed has of a task's, where seeds are drawn again."""
    if rng is None:
        return np.full((n, n_tasks, n_seeds), 1 / n_seeds)
    return times_drawn(rng, n_seeds, n * n_tasks).reshape(n, n_tasks, n_seeds) / n_seeds


def _ranked(
    by: Float[np.ndarray, "B methods draws tasks"], draws: Int[np.ndarray, "B draws"]
) -> Int[np.ndarray, "B methods tasks draws"]:
    """The draws that were drawn, the best first; of equal ones the first."""
    there = np.moveaxis(np.take_along_axis(np.round(by, 12), draws[:, None, :, None], 2), 2, 3)
    return np.take_along_axis(draws[:, None, None], np.argsort(-there, axis=3, kind="stable"), 3)


def _above(
    scores: Scores,
    base: int,
    ours: Int[np.ndarray, "B methods tasks"],
    theirs: Int[np.ndarray, "B tasks"],
    weights: Float[np.ndarray, "B tasks seeds"],
) -> Float[np.ndarray, "B methods tasks"]:
    """P(above the baseline) on each task, where each method has its draw of that task; a tie counts half."""
    methods, tasks = np.arange(scores.shape[0])[:, None], np.arange(scores.shape[2])
    pairs = pairs_above(scores[methods, ours, tasks], scores[base, theirs, tasks][:, None])
    return np.einsum("bmkst,bks,bkt->bmk", pairs, weights, weights, optimize=True)


def _interval(mean: Float[np.ndarray, "*n"], again: Float[np.ndarray, "B *n"], is_share: bool) -> Interval:
    """The resamples' percentiles about the estimate. Selecting from fewer different draws has moved their mean."""
    ends = np.quantile(again, (0.025, 0.975), axis=0) + mean - again.mean(0)
    low, high = np.clip(ends, 0, 1) if is_share else ends
    return Interval(mean, np.minimum(low, mean), np.maximum(high, mean))
