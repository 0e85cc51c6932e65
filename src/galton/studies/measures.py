"""Numbers that claims and tables quote, each with its interval."""

from collections.abc import Sequence

import numpy as np
from jaxtyping import Float

from galton.analysis.statistics import Interval, difference_interval, mean_interval, stratified_bootstrap
from galton.studies.base import Data
from galton.studies.summary import Summary

CLASSIFICATION = ("hl-one-hot", "hl-gauss")
"""The paper's two."""

Scores = Float[np.ndarray, " trials"]


def winner(data: Data, task: str) -> Summary:
    """The sweep to judge the best settings by: their re-run on fresh seeds where that is done."""
    return data.sweeps.get(f"{task}-again", data.sweeps[task])


def final_return(summary: Summary, loss: str, metric: str = "training_return") -> Scores:
    """Of each trial of the loss's best setting; a run that diverged counts as the worst that any run ended with."""
    return np.asarray(_filled(summary.final(metric))[summary.rows(summary.best[loss].setting)])


def mean_return(summary: Summary, loss: str) -> Scores:
    """Mean training return over all of training, the area under each trial's curve: how fast it learns."""
    return np.asarray(_filled(summary.curves("training_return")[summary.rows(summary.best[loss].setting)]).mean(1))


def _filled(returns: Float[np.ndarray, "*any"]) -> Float[np.ndarray, "*any"]:
    """Each NaN as the worst that is known, if anything is."""
    known = returns[~np.isnan(returns)]
    return np.where(np.isnan(returns), known.min(), returns) if len(known) else returns


def better_classification(data: Data, task: str, score: str = "final") -> tuple[str, Interval]:
    """The better of the two classification losses, and what it gains over the Gaussian."""
    of = final_return if score == "final" else mean_return
    summary = winner(data, task)
    scores = {loss: of(summary, loss) for loss in CLASSIFICATION}
    best = max(scores, key=lambda loss: float(scores[loss].mean()))
    return best, difference_interval(scores[best], of(summary, "gaussian"))


def spread(summary: Summary, loss: str, field: str) -> Interval | None:
    """How much a field moves the final return: the range of its marginal means, in units of what training gains.

    That is the best setting's mean final return less the mean return at the first log point, of all runs. None where
    the grid does not vary the field. The interval is bootstrapped over trials.
    """
    final = _filled(summary.final("training_return"))
    own = [setting for setting in summary.study.settings if setting.config.loss == loss]
    values = np.array([setting.record()[field] for setting in own])
    if len(set(values)) < 2:
        return None
    best = max(final[summary.setting == i].mean() for i in np.unique(summary.setting))
    gain = best - mean_interval(summary.curves("training_return")[:, 0]).mean

    def moved(scores: Sequence[Scores]) -> float:
        means = np.array([score.mean() for score in scores])
        return float(np.ptp([means[values == value].mean() for value in set(values)]) / gain)

    return stratified_bootstrap([final[summary.rows(setting)] for setting in own], moved, n_resamples=500)
