"""Numbers that claims and tables quote, each with its interval."""

import functools
from collections.abc import Callable

import numpy as np
from jaxtyping import Float

from galton.analysis.statistics import Interval, difference_interval, mean_interval
from galton.envs.base import Environment
from galton.envs.find import find
from galton.losses import LOSSES
from galton.paper.summary import Summary
from galton.paper.trained import Judged
from galton.tasks import TASKS

CLASSIFICATION = ("hl-one-hot", "hl-gauss")
"""The paper's two losses that classify."""

Scores = Float[np.ndarray, " trials"]


@functools.cache
def optimum(task: str) -> float | None:
    """The return of the best controller, where it is known."""
    if not TASKS[task].in_jax:
        return None
    env = find(TASKS[task].env)
    return env.optimal_return if isinstance(env, Environment) else None


def final_return(summary: Summary, loss: str, metric: str = "training_return") -> Scores:
    """The final return of each trial of the loss's best setting."""
    finals = _filled(summary, summary.final(metric), metric)
    return np.asarray(finals[summary.rows(summary.best[loss].setting)])


def mean_return(summary: Summary, loss: str, metric: str = "training_return") -> Scores:
    """Mean return over all of training, the area under each trial's curve: how fast it learns."""
    curves = _filled(summary, summary.curves(metric), metric)
    return np.asarray(curves[summary.rows(summary.best[loss].setting)].mean(1))


def _filled(summary: Summary, returns: Float[np.ndarray, "*any"], metric: str) -> Float[np.ndarray, "*any"]:
    """The returns; where a run has diverged, the worst that any run of the paper's losses did in this sweep."""
    if not np.isnan(returns).any():
        return returns
    curves = summary.curves(metric)[_of_the_paper(summary)]
    known = curves[~np.isnan(curves)]
    return np.where(np.isnan(returns), known.min(), returns) if len(known) else returns


def _of_the_paper(summary: Summary) -> np.ndarray:
    settings = summary.study.settings
    return summary.rows(*(setting for setting in settings if LOSSES[setting.config.loss].in_paper))


def better(chosen: Summary, score: Callable[[Summary, str], Scores]) -> str:
    """The classification loss with the higher score where settings were chosen too."""
    return max(CLASSIFICATION, key=lambda loss: float(score(chosen, loss).mean()))


def over_regression(task: Judged, score: Callable[[Summary, str], Scores] = final_return) -> Interval:
    """What the better classification loss gains over the Gaussian, on fresh seeds."""
    return difference_interval(score(task.again, better(task.chosen, score)), score(task.again, "gaussian"))


def progress(summary: Summary) -> tuple[float, float]:
    """Mean training return at the first log point, and finally under the best setting, of the paper's losses."""
    first = summary.curves("training_return")[_of_the_paper(summary), 0]
    bests = [loss for loss in summary.best if LOSSES[loss].in_paper]
    return float(mean_interval(first).mean), max(float(final_return(summary, loss).mean()) for loss in bests)


def by_setting(summary: Summary, loss: str) -> Float[np.ndarray, "settings trials"]:
    """Final training return of every run of a loss; a diverged one has the worst of all."""
    finals = _filled(summary, summary.final("training_return"), "training_return")
    own = [setting for setting in summary.study.settings if setting.config.loss == loss]
    return np.array([finals[summary.rows(setting)] for setting in own])


def by_value(summary: Summary, loss: str, field: str) -> dict[float, Scores]:
    """The mean over settings of each trial's final return, by the value of a field: its marginals."""
    finals = by_setting(summary, loss)
    values = np.array([s.record()[field] for s in summary.study.settings if s.config.loss == loss])
    return {float(value): finals[values == value].mean(0) for value in np.unique(values)}


def spread(summary: Summary, loss: str, field: str) -> Interval | None:
    """How much a field moves the final return: its best value's marginal mean less its worst's, of what training gains.

    The two values are chosen by one half of the trials and compared by the other, and the other way round: were the
    field without effect, the mean would be 0. None where the grid does not vary it, or where nothing is gained.
    """
    marginals = np.array([*by_value(summary, loss, field).values()])
    start, end = progress(summary)
    if len(marginals) < 2 or not end > start:
        return None
    half = np.arange(marginals.shape[1]) % 2
    differences = np.full(len(half), np.nan)
    for here in (0, 1):
        means = marginals[:, half != here].mean(1)
        differences[half == here] = (marginals[means.argmax()] - marginals[means.argmin()])[half == here]
    return Interval(*(bound / (end - start) for bound in mean_interval(differences)))
