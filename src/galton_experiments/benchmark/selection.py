"""A method is judged by one of its draws for all tuning tasks, and by one for each (Patterson et al., 2024)."""

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from galton_experiments.analysis.aggregates import best_of, percentiles

Judged = Mapping[str, Mapping[str, Float[np.ndarray, "rows trials"]]]
"""The judged numbers of runs, by task and method: a row for each draw, or for each role, and NaN for a diverged run."""


class Selected(NamedTuple):
    """The draws that were selected, by method."""

    shared: dict[str, int]
    """The draw with the highest mean score over all tuning tasks."""
    per_task: dict[str, dict[str, int]]
    """The draw with the highest mean score on each task, by task."""


class BestOf(NamedTuple):
    """The mean normalised score that tuning with n = 1 … N draws gets."""

    shared: Float[np.ndarray, " N"]
    """Of one setting for all tasks."""
    per_task: Float[np.ndarray, " N"]
    """Of one for each task."""


def normalised(judged: Judged) -> dict[str, dict[str, Float[np.ndarray, "rows trials"]]]:
    """The same runs as their percentiles among all runs of all methods on their task."""
    found = {}
    for task, of_method in judged.items():
        pool = np.concatenate([runs.ravel() for runs in of_method.values()])
        found[task] = {method: percentiles(runs, pool) for method, runs in of_method.items()}
    return found


def select(scores: Judged) -> Selected:
    """The draws with the highest mean scores; of equal ones the first, whatever the order of sums rounds to."""
    shared = {
        method: int(_rounded(np.mean([of_method[method].mean(1) for of_method in scores.values()], axis=0)).argmax())
        for method in next(iter(scores.values()))
    }
    per_task = {
        task: {method: int(_rounded(runs.mean(1)).argmax()) for method, runs in of_method.items()}
        for task, of_method in scores.items()
    }
    return Selected(shared, per_task)


def best_of_draws(scores: Judged, method: str) -> BestOf:
    """Compute what tuning with fewer draws would have got, on average over the subsets of a method's draws.

    With several seeds each judges what the others choose, so that the best does not flatter; one alone does both.
    """
    runs = np.array([of_method[method] for of_method in scores.values()])  # [tasks, draws, trials]
    n_trials = runs.shape[2]
    shared, per_task = [], []
    for trial in range(n_trials):
        others = [other for other in range(n_trials) if other != trial] or [trial]
        chosen_by, worth = runs[:, :, others].mean(2), runs[:, :, trial]
        shared.append(best_of(_rounded(chosen_by.mean(0)), worth.mean(0)))
        per_task += [best_of(_rounded(by), of) for by, of in zip(chosen_by, worth, strict=True)]
    return BestOf(np.mean(shared, axis=0), np.mean(per_task, axis=0))


def _rounded(scores: Float[np.ndarray, " draws"]) -> Float[np.ndarray, " draws"]:
    """Means of percentiles, without the last bits in which sums of equal ones differ."""
    return np.round(scores, 12)
