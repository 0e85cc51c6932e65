"""What the paper says of all settings together (§5.1, Apps C.3 and C.4)."""

import functools
from collections.abc import Callable, Sequence

import numpy as np
from scipy import stats

from galton.analysis.page import Claim
from galton.analysis.statistics import Interval, difference_interval, stratified_bootstrap
from galton.studies.base import Data
from galton.studies.claims.verdicts import A_TENTH, listed, sorted_out, verdict
from galton.studies.measures import CLASSIFICATION, by_setting, by_value, grids, progress, spread
from galton.studies.summary import Summary
from galton.tasks import TASKS

_HIGH = 0.9
"""Of the way from the first log point to the best setting."""


def _sensitive(data: Data, loss: str, field: str, much: bool, words: str, section: str) -> Claim:
    """App. C.3: a field moves the mean final return by more, or less, than a tenth of what training gains."""
    moved = {TASKS[task].title: spread(summary, loss, field) for task, summary in grids(data).items()}
    known = {name: interval for name, interval in moved.items() if interval is not None}
    gaps = {
        name: Interval(mean - A_TENTH, low - A_TENTH, high - A_TENTH)
        if much
        else Interval(A_TENTH - mean, A_TENTH - high, A_TENTH - low)
        for name, (mean, low, high) in known.items()
    }
    return Claim(
        "App. C.3",
        words,
        "marginal mean final return, best − worst value, as a share of what training gains (values chosen by one half "
        "of the trials, compared by the other); a tenth divides sensitive from robust",
        listed(known, ".2f"),
        verdict(gaps.values()),
        sorted_out(gaps),
        section,
    )


def sensitivities(data: Data) -> list[Claim]:
    """App. C.3, Figures 4 to 6."""
    rate, k, eta = "learning_rate", "n_bins", "eta"
    return [
        _sensitive(data, "hl-gauss", rate, True, "HL-Gauss is sensitive to the learning rate.", "figure-4"),
        _sensitive(data, "hl-gauss", eta, True, "HL-Gauss is sensitive to η.", "figure-4"),
        wide_targets(data),
        _sensitive(data, "hl-gauss", k, False, "HL-Gauss is robust to the number of bins.", "figure-4"),
        _sensitive(data, "hl-one-hot", k, False, "HL-1-Hot is robust to the number of bins.", "figure-5"),
        _sensitive(data, "hl-one-hot", rate, True, "HL-1-Hot is sensitive to the learning rate.", "figure-5"),
        _sensitive(data, "gaussian", rate, True, "The Gaussian is sensitive to the learning rate.", "figure-6"),
    ]


def wide_targets(data: Data) -> Claim:
    """App. C.3, Figure 4."""
    gaps = {}
    for task, summary in grids(data).items():
        marginals = [*by_value(summary, "hl-gauss", "eta").values()]
        if len(marginals) > 1:
            gaps[TASKS[task].title] = difference_interval(marginals[0], marginals[-1])
    return Claim(
        "App. C.3",
        "With η too large HL-Gauss degrades.",
        "marginal mean final return: smallest − largest η of the grid",
        listed(gaps),
        verdict(gaps.values()),
        sorted_out(gaps),
        "figure-4",
    )


def robust_to_settings(data: Data) -> Claim:
    """§5.1, Figure 7."""

    def above(ours: np.ndarray, theirs: np.ndarray) -> float:
        pairs = stats.mannwhitneyu(ours, theirs, method="asymptotic").statistic
        return float(pairs / (len(ours) * len(theirs)) - 0.5)

    gaps = {TASKS[task].title: _over_gaussian(summary, above) for task, summary in grids(data).items()}
    return Claim(
        "§5.1",
        "Classification is more robust to hyperparameters.",
        "chance that a run of classification, of any setting, ends above a run of the Gaussian, less ½; mean of "
        "HL-1-Hot and HL-Gauss",
        listed(gaps),
        verdict(gaps.values()),
        sorted_out(gaps),
        "figure-7",
    )


def higher_fraction(data: Data) -> Claim:
    """App. C.4, Figure 7."""
    gaps = {}
    for task, summary in grids(data).items():
        start, end = progress(summary)
        if end > start:
            high = start + _HIGH * (end - start)
            gaps[TASKS[task].title] = _over_gaussian(summary, functools.partial(_more_above, high))
    return Claim(
        "App. C.4",
        "Over all settings, a higher fraction of classification's runs reaches a high return.",
        "share of runs that end above nine tenths of what training gains with the best setting: mean of HL-1-Hot's and "
        "HL-Gauss's − Gaussian's",
        listed(gaps),
        verdict(gaps.values()),
        sorted_out(gaps),
        "figure-7",
    )


def _more_above(high: float, ours: np.ndarray, theirs: np.ndarray) -> float:
    return float((ours > high).mean() - (theirs > high).mean())


def _over_gaussian(summary: Summary, more: Callable[[np.ndarray, np.ndarray], float]) -> Interval:
    """Of all runs of a classification loss against all of the Gaussian, mean of both losses; trials are resampled."""
    groups = [by_setting(summary, loss) for loss in ("gaussian", *CLASSIFICATION)]
    ends = np.cumsum([len(group) for group in groups])[:-1]

    def mean(settings: Sequence[np.ndarray]) -> float:
        theirs, *ours = (group.ravel() for group in np.split(np.array(settings), ends))
        return float(np.mean([more(each, theirs) for each in ours]))

    return stratified_bootstrap([*np.concatenate(groups)], mean, n_resamples=500)
