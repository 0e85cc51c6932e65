"""Numbers over many tasks, after Agarwal et al. (2021) and Patterson et al. (2024), and the best of n draws."""

import functools
import math
from collections.abc import Sequence

import numpy as np
from jaxtyping import Float

from galton.errors import require
from galton_experiments.analysis.bands import RESAMPLES, times_drawn
from galton_experiments.analysis.statistics import Interval, Tasks, diverged_lowest, pairs_above


def percentiles(values: Float[np.ndarray, "*any"], pool: Float[np.ndarray, " P"]) -> Float[np.ndarray, "*any"]:
    """Return each value's percentile rank in a pool: the share of it that is below, and half of what is equal.

    It is the pool's cumulative distribution, by which tasks of any scale of reward get one scale from 0 to 1. A
    diverged run, NaN, is below all others.
    """
    require(pool.size > 0, "pool is empty; give the runs that values are to be ranked among")
    ranked, among = (diverged_lowest(numbers) for numbers in (values, pool))
    among = np.sort(among)
    below, not_above = (np.searchsorted(among, ranked, side) for side in ("left", "right"))
    return np.asarray((below + not_above) / (2 * among.size))


def interquartile_mean(scores: Tasks, n_resamples: int = RESAMPLES, seed: int = 0) -> Interval:
    """The mean of the middle half of all tasks' scores, and its interval, runs drawn again within each task.

    A diverged run, NaN, is below all others. The interval is NaN if a task has fewer than two runs.
    """
    tasks = [diverged_lowest(task) for task in scores]
    require(bool(tasks) and all(task.size for task in tasks), "scores lacks a task's runs; give one or more of each")
    mean = _middle_mean(np.concatenate(tasks)[None])[0]
    if min(task.size for task in tasks) < 2:
        return Interval(mean, np.float64(np.nan), np.float64(np.nan))
    rng = np.random.default_rng(seed)
    again = [task[rng.integers(len(task), size=(n_resamples, len(task)))] for task in tasks]
    return Interval(
        mean, *np.quantile(_middle_mean(np.concatenate(again, axis=1)), (0.025, 0.975), method="inverted_cdf")
    )


def _middle_mean(rows: Float[np.ndarray, "B n"]) -> Float[np.ndarray, " B"]:
    """The mean of each row without its lowest and its highest quarter."""
    cut = rows.shape[1] // 4
    return np.asarray(np.sort(rows, axis=1)[:, cut : rows.shape[1] - cut].mean(1))


def improvement(
    ours: Tasks, theirs: Tasks, n_resamples: int = RESAMPLES, seed: int = 0, paired: bool = False
) -> Interval:
    """P(X > Y), the chance that a run of the first is above one of the second on a task that is drawn at random.

    A tie counts half. The interval is that of percentiles when the runs of each task and side are drawn again, each
    side by itself; NaN if a task has fewer than two of either, or one side fewer than five over all tasks, and a
    `ByTask` where it is a point although tasks differ. A diverged run, NaN, is below all others. Paired, run i of both
    sides had the same seed, and the two are drawn together: what a seed does to both is then not taken for a
    difference. (What drawing pairs again adds to the mean is known, and taken off.)
    """
    require(len(ours) == len(theirs) > 0, f"ours has {len(ours)} tasks and theirs {len(theirs)}; give the same ones")
    sizes = [(len(a), len(b)) for a, b in zip(ours, theirs, strict=True)]
    require(
        not paired or all(n == m for n, m in sizes), f"ours and theirs have {sizes} runs; pairs need as many of both"
    )
    above = [pairs_above(diverged_lowest(a), diverged_lowest(b)) for a, b in zip(ours, theirs, strict=True)]
    mean = np.mean([pairs.mean() for pairs in above])
    if min(min(pairs.shape) for pairs in above) < 2 or min(map(sum, zip(*sizes, strict=True))) < 5:
        return Interval(mean, np.float64(np.nan), np.float64(np.nan))
    total = np.zeros(n_resamples)
    again = _drawn_again(tuple(pairs.shape for pairs in above), n_resamples, seed, paired)
    for pairs, (rows, columns) in zip(above, again, strict=True):
        total += ((pairs.T @ rows) * columns).sum(0) / pairs.size
        if paired:  # of a run that is drawn twice each copy meets the other's pair, which moves the mean by as much
            total -= (np.diagonal(pairs).mean() - pairs.mean()) / len(pairs)
    low, high = np.quantile(np.clip(total / len(above), 0, 1), (0.025, 0.975))
    by_task = [float(pairs.mean()) for pairs in above]
    if high - low < 1e-9 and max(by_task) - min(by_task) > 1e-9:
        found = ByTask(mean, np.float64(np.nan), np.float64(np.nan))
        found.by_task = by_task
        return found
    return Interval(mean, low, high)


class ByTask(Interval):
    """A mean over tasks that differ, where drawing runs again changes nothing: it is written task by task.

    Its interval is not known, for runs say nothing of other tasks.
    """

    by_task: Sequence[float]
    """The number of each task."""

    def __format__(self, spec: str) -> str:
        """The numbers of all tasks, in their order."""
        return f"{', '.join(f'{number:.2g}' for number in self.by_task)} by task"


@functools.lru_cache(maxsize=2)  # each two methods of a stage have the same
def _drawn_again(
    shapes: tuple[tuple[int, ...], ...], n_resamples: int, seed: int, paired: bool
) -> list[tuple[Float[np.ndarray, "n B"], Float[np.ndarray, "m B"]]]:
    """Resample the runs of both sides, task by task, and count how often each is drawn."""
    rng, found = np.random.default_rng(seed), []
    for n, m in shapes:
        rows = times_drawn(rng, n, n_resamples).T.astype(float, order="C")
        found.append((rows, rows if paired else times_drawn(rng, m, n_resamples).T.astype(float, order="C")))
    return found


def best_of(chosen_by: Float[np.ndarray, " N"], worth: Float[np.ndarray, " N"]) -> Float[np.ndarray, " N"]:
    """Return the expected worth of the best of n draws, n = 1 … N: the exact mean over all subsets of n of N draws.

    Args:
        chosen_by: each draw's score, by which the best of a subset is chosen; of equal ones it is the first.
        worth: what each draw is worth where it is chosen. Given the same scores this is the expected maximum, which
            flatters; given other runs' scores of the same draws it doesn't.
    """
    order = np.argsort(-chosen_by, kind="stable")  # the first is chosen wherever it is in the subset
    return np.asarray(chances_of_best(len(order)) @ worth[order])


def chances_of_best(n: int) -> Float[np.ndarray, "N N"]:
    """The chance that each of N draws, in order from the best, is the best of a subset of n = 1 … N of them."""
    chances = [[math.comb(n - 1 - rank, size - 1) for rank in range(n)] for size in range(1, n + 1)]
    return np.array([[chance / sum(row) for chance in row] for row in chances])
