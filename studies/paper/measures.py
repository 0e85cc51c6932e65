"""Numbers that claims and tables quote, one per run, and what compares those of two losses."""

import functools
from collections.abc import Callable, Sequence

import numpy as np
from jaxtyping import Float

from galton.losses import LOSSES
from galton.training import MEAN_ACTION_RETURN
from galton_experiments.analysis import Comparison, compare, fill_start
from galton_experiments.runs import Summary
from galton_experiments.sweep import Setting
from studies.paper.trained import Judged, Scale

CLASSIFICATION = ("hl-one-hot", "hl-gauss")
"""The paper's two losses that classify."""
DETERMINISTIC = {"evaluation_return": "most likely action", MEAN_ACTION_RETURN: "mean action"}
"""The returns of the deterministic policy, by which action it takes; the second is not in every summary."""

Scores = Float[np.ndarray, " trials"]
Score = Callable[[Summary, str], Scores]
"""A number of each trial of a loss's best setting."""


def final_return(summary: Summary, loss: str, metric: str = "training_return") -> Scores:
    """The final return of each trial of the loss's best setting."""
    return final_of(summary, summary.best[loss].setting, metric)


def final_of(summary: Summary, setting: Setting, metric: str) -> Scores:
    """The final return of each trial of a setting; a diverged one has the worst of the whole sweep."""
    return np.asarray(_filled(summary, summary.final(metric), metric)[summary.rows(setting)])


def mean_return(summary: Summary, loss: str, metric: str = "training_return") -> Scores:
    """Mean return over all of training, the area under each trial's curve."""
    return np.asarray(curves_of(summary, loss, metric).mean(1))


def steps_to(summary: Summary, loss: str, level: float, metric: str = "training_return") -> Scores:
    """Environment steps at the first log point where each trial's return is at least a level.

    A trial that never gets there has one log point more than all: it is later than every other.
    """
    steps, there = summary.steps, curves_of(summary, loss, metric) >= level
    never = steps[-1] + steps[0]
    return np.where(there.any(1), steps[there.argmax(1)], never).astype(np.float64)


def drawdown(summary: Summary, loss: str, scale: Scale) -> Scores:
    """Measure each trial's drop in the end from its best log point, as a share of the way from rest to the best.

    It is read off the training return, a mean over all episodes between two log points: the best of a hundred
    evaluations of a few episodes would be mostly luck.
    """
    lost = curves_of(summary, loss, "training_return").max(1) - final_return(summary, loss)
    return np.asarray(lost / (scale.best - scale.rest))


def apart(summary: Summary, loss: str) -> Scores:
    """Measure how far each trial's final training return is from the median of all."""
    finals = final_return(summary, loss)
    return np.asarray(np.abs(finals - np.median(finals)))


def curves_of(summary: Summary, loss: str, metric: str) -> Float[np.ndarray, "trials L"]:
    """The curves of a loss's best setting."""
    return np.asarray(_curves(summary, metric)[summary.rows(summary.best[loss].setting)])


def _curves(summary: Summary, metric: str) -> Float[np.ndarray, "runs L"]:
    """All curves: before a run's first finished episode its first return, after it diverged the sweep's worst."""
    return _filled(summary, fill_start(summary.curves(metric)), metric)


def logged(summary: Summary) -> dict[str, str]:
    """Those of DETERMINISTIC that a summary has."""
    return {metric: name for metric, name in DETERMINISTIC.items() if metric in summary.table.column_names}


def _filled(summary: Summary, returns: Float[np.ndarray, "*any"], metric: str) -> Float[np.ndarray, "*any"]:
    """The returns; where a run has diverged, the worst that any run of the paper's losses did in this sweep."""
    if not np.isnan(returns).any():
        return returns
    own = (setting for setting in summary.study.settings if LOSSES[setting["loss"]].in_paper)
    curves = summary.curves(metric)[summary.rows(*own)]
    known = curves[~np.isnan(curves)]
    return np.where(np.isnan(returns), known.min(), returns) if len(known) else returns


def better(chosen: Summary, score: Score) -> str:
    """The classification loss with the higher score where settings were chosen too, of those that were trained."""
    trained = [loss for loss in CLASSIFICATION if loss in chosen.best]
    return max(trained, key=lambda loss: float(score(chosen, loss).mean()))


def versus(summary: Summary, ours: str, theirs: str, score: Score) -> Comparison:
    """One loss's trials against another's in one sweep, in pairs where they have common seeds."""
    return compare(score(summary, ours), score(summary, theirs), summary.study.common_seeds)


def over_regression(
    task: Judged, measure: Callable[..., Scores] = final_return, metric: str = "training_return"
) -> Comparison:
    """Compare the better classification loss with the Gaussian, on fresh seeds."""
    score = functools.partial(measure, metric=metric)
    return versus(task.again, better_by(task.chosen, measure, metric), "gaussian", score)


def better_by(chosen: Summary, measure: Callable[..., Scores], metric: str) -> str:
    """`better` by a metric; where settings were chosen without it, by the most likely action's return instead."""
    known = metric if metric in chosen.table.column_names else "evaluation_return"
    return better(chosen, functools.partial(measure, metric=known))


def by_setting(summary: Summary, loss: str) -> Float[np.ndarray, "settings trials"]:
    """Final training return of every run of a loss; a diverged one has the worst of all."""
    finals = _filled(summary, summary.final("training_return"), "training_return")
    own = [setting for setting in summary.study.settings if setting["loss"] == loss]
    return np.array([finals[summary.rows(setting)] for setting in own])


def over_training(summary: Summary) -> dict[Setting, float]:
    """The mean training return of each setting that was trained, over all of training and its trials."""
    means = _curves(summary, "training_return").mean(1)
    found = {setting: means[summary.rows(setting)] for setting in summary.study.settings}
    return {setting: float(runs.mean()) for setting, runs in found.items() if len(runs)}


def by_value(summary: Summary, loss: str, field: str) -> dict[float, Scores]:
    """The mean over settings of each trial's final return, by the value of a field: its marginals."""
    finals = by_setting(summary, loss)
    values = np.array([s.record()[field] for s in summary.study.settings if s["loss"] == loss])
    return {float(value): finals[values == value].mean(0) for value in np.unique(values)}


def spread(summary: Summary, loss: str, field: str, scale: Scale) -> Scores | None:
    """Measure how much a field moves each trial's final return, as a share of the way from rest to the best.

    It is the marginal mean of its best value less that of its worst. The two are chosen by one half of the trials and
    compared by the other, and the other way round: were the field without effect, the mean would be 0. None where the
    grid does not vary it, or where there is but one trial.
    """
    marginals = np.array([*by_value(summary, loss, field).values()])
    if len(marginals) < 2 or summary.study.trials < 2:
        return None
    half = np.arange(marginals.shape[1]) % 2
    differences = np.full(len(half), np.nan)
    for here in (0, 1):
        means = marginals[:, half != here].mean(1)
        differences[half == here] = (marginals[means.argmax()] - marginals[means.argmin()])[half == here]
    return differences / (scale.best - scale.rest)


def rate_spreads(grid: Summary, losses: Sequence[str], of: str, scale: Scale) -> dict[str, tuple[Scores, Scores]]:
    """Measure how much the learning rate moves some losses and another one, by label, where the grid varies both."""
    theirs = spread(grid, of, "learning_rate", scale)
    found = {LOSSES[loss].label: spread(grid, loss, "learning_rate", scale) for loss in losses}
    return {name: (ours, theirs) for name, ours in found.items() if ours is not None and theirs is not None}
