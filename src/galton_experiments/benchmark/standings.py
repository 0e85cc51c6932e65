"""Fresh seeds judge the methods: normalised scores, comparisons with the baseline, and what tuning brings."""

import dataclasses
from collections.abc import Collection, Mapping, Sequence
from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from galton_experiments.analysis.aggregates import improvement, interquartile_mean
from galton_experiments.analysis.bands import RESAMPLES, mean_band
from galton_experiments.analysis.statistics import Interval, compare, mean_interval
from galton_experiments.analysis.verdicts import decide
from galton_experiments.benchmark.protocol import Protocol
from galton_experiments.benchmark.runs import CURVES, Runs
from galton_experiments.benchmark.selection import Judged, normalised
from galton_experiments.benchmark.stages import Role

UNKNOWN = Interval(*[np.float64(np.nan)] * 3)
"""The interval of a number that is not known."""


class Score(NamedTuple):
    """A score says how a method does over all tasks of a stage, by percentiles among all methods' runs of each task."""

    judged: Interval
    """The mean over tasks of the mean over runs, by what runs are judged by."""
    middle: Interval
    """The interquartile mean of all runs, by the same: it may leave out a whole task, where a method fails or wins."""
    training: Interval
    """The mean as `judged`, by the training return; NaN where a run that has not diverged has none."""


class Result(NamedTuple):
    """A result says how a method does on one task; a diverged run counts as the worst of any method's there."""

    judged: Interval
    """The mean return that runs are judged by, with Student's interval."""
    training: Interval
    """The same of the training return; NaN where a run of the task that has not diverged has none."""
    worst: float
    """The worst run, by what it is judged by; NaN where every run of the task diverged."""
    diverged: int


class Versus(NamedTuple):
    """A method is compared with the baseline on one task, by what runs are judged by, in pairs of one seed."""

    difference: Interval
    direction: int
    """1 where both the mean and the ranks of the test say that it is better, −1 worse, 0 where they disagree."""
    above: float
    """P(X > Y), a tie counting half."""
    p: float
    """Of a two-sided rank test, adjusted for all tasks of the stage by Holm's method; NaN with too few runs."""


@dataclasses.dataclass(frozen=True)
class Standings:
    """Standings hold what one stage on fresh seeds found, by method; roles are those of `stages.Role`."""

    tasks: tuple[str, ...]
    scores: Mapping[str, Mapping[Role, Score]]
    above: Mapping[str, Mapping[str, Interval]]
    """P(X > Y) over all tasks for each two methods, by what runs of the shared settings are judged by."""
    above_in_training: Mapping[str, Interval]
    """P(X > baseline) by the training return."""
    above_per_task: Mapping[str, Interval]
    """P(X > baseline) of the settings selected for each task, as `above`; empty where `sensitivity` is."""
    results: Mapping[str, Mapping[str, Mapping[Role, Result]]]
    """By task, method and role."""
    versus: Mapping[str, Mapping[str, Versus]]
    """Each method's shared setting against the baseline's, by method and task."""
    sensitivity: Mapping[str, Interval]
    """The normalised score of the settings selected for each task less that of the shared one; empty where no setting
    was selected by these tasks."""


def standings(protocol: Protocol, runs: Sequence[Runs]) -> Standings:
    """Compare the methods by the runs of one stage, one `Runs` for each of its tasks."""
    methods, base = [method.name for method in protocol.methods], protocol.baseline.name
    others = [method for method in methods if method != base]
    roles: tuple[Role, ...] = ("shared",) if runs[0].stage == "held-out" else ("shared", "per-task")
    finals = {curve: _finals(runs, methods, roles, curve) for curve in CURVES}
    judged, training = (normalised(finals[curve]) for curve in CURVES)
    untold = {each.task for each in runs if _is_untold(*(finals[curve][each.task] for curve in CURVES))}
    filled = {curve: {task: with_worst(of_task) for task, of_task in finals[curve].items()} for curve in CURVES}
    return Standings(
        tasks=tuple(judged),
        scores={
            m: {role: _score(judged, {} if untold else training, m, i) for i, role in enumerate(roles)} for m in methods
        },
        above={m: {other: _improvement(judged, m, other) for other in methods if other != m} for m in methods},
        above_in_training={m: UNKNOWN if untold else _improvement(training, m, base) for m in others},
        above_per_task={m: _improvement(judged, m, base, 1) for m in others} if "per-task" in roles else {},
        results={each.task: {m: _results(each, filled, m, roles, untold) for m in methods} for each in runs},
        versus={m: _versus(finals["judged"], filled["judged"], m, base) for m in others},
        sensitivity={m: _sensitivity(judged, m) for m in methods} if "per-task" in roles else {},
    )


def _score(judged: Judged, training: Judged, method: str, row: int) -> Score:
    """The scores of a method in one role."""
    found, trained = _of(judged, method, row), _of(training, method, row)
    in_training = mean_band(trained, RESAMPLES) if trained else UNKNOWN
    return Score(mean_band(found, RESAMPLES), interquartile_mean(found), in_training)


def _improvement(scores: Judged, method: str, other: str, row: int = 0) -> Interval:
    """P(X > Y) of two methods in one role, whose runs of one trial have the same seed."""
    return improvement(_of(scores, method, row), _of(scores, other, row), paired=True)


def _is_untold(judged: Mapping[str, np.ndarray], training: Mapping[str, np.ndarray]) -> bool:
    """Say whether a run that has not diverged has no training return, because none of its episodes ended."""
    return any(bool((np.isnan(runs) & ~np.isnan(judged[method])).any()) for method, runs in training.items())


def _results(
    runs: Runs, filled: Mapping[str, Judged], method: str, roles: Sequence[Role], untold: Collection[str]
) -> dict[Role, Result]:
    """Return the results of a method on one task, in each role."""
    judged, training = (filled[curve][runs.task][method] for curve in CURVES)
    return {
        role: Result(
            mean_interval(judged[i]),
            UNKNOWN if runs.task in untold else mean_interval(training[i]),
            float(judged[i].min()),
            runs.diverged(method, role),
        )
        for i, role in enumerate(roles)
    }


def _finals(
    runs: Sequence[Runs], methods: Sequence[str], roles: Sequence[Role], curve: str
) -> dict[str, dict[str, Float[np.ndarray, "roles trials"]]]:
    """The final returns of all runs by task and method, a row for each role."""
    return {
        each.task: {m: np.concatenate([each.finals(m, role, curve) for role in roles]) for m in methods}
        for each in runs
    }


def with_worst(
    of_method: Mapping[str, Float[np.ndarray, "roles trials"]],
) -> dict[str, Float[np.ndarray, "roles trials"]]:
    """The returns on one task, those of diverged runs as the worst that any run had."""
    known = np.concatenate([runs[~np.isnan(runs)] for runs in of_method.values()])
    worst = known.min() if known.size else np.nan
    return {method: np.where(np.isnan(runs), worst, runs) for method, runs in of_method.items()}


def _of(scores: Judged, method: str, row: int) -> list[Float[np.ndarray, " trials"]]:
    """A method's scores in one role, task by task."""
    return [np.asarray(of_method[method][row]) for of_method in scores.values()]


def _versus(finals: Judged, filled: Judged, method: str, base: str) -> dict[str, Versus]:
    """Each task by itself. A diverged run is below all others by rank, and is the worst of them in the mean."""
    found = {}
    for task, runs in finals.items():
        worst = min(float(of_method.min()) for of_method in filled[task].values())
        lowest = worst if np.isnan(worst) else -np.inf  # where all of a task diverged nothing is known
        ours, theirs = (np.where(np.isnan(runs[name][0]), lowest, runs[name][0]) for name in (method, base))
        found[task] = compare(ours, theirs, paired=True, worst=worst)
    decided = decide(found)
    return {task: Versus(each.difference, each.direction, each.above, decided[task].p) for task, each in found.items()}


def _sensitivity(scores: Judged, method: str) -> Interval:
    """Runs of one seed are drawn again together, and where both settings are one the difference is 0."""
    return mean_band([of_method[method][1] - of_method[method][0] for of_method in scores.values()], RESAMPLES)
