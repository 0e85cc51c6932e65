"""What the paper says of all settings together (§5.1, Apps C.3 and C.4)."""

from collections.abc import Sequence

import numpy as np

from galton.analysis.page import Claim
from galton.analysis.statistics import Interval, difference_interval, probability_of_improvement, stratified_bootstrap
from galton.studies.base import Data, present
from galton.studies.claims.verdicts import A_TENTH, listed, sorted_out, verdict
from galton.studies.figure_7 import finals
from galton.studies.measures import CLASSIFICATION, by_setting, by_value, progress, spread
from galton.studies.sweeps import TASKS

_HIGH = 0.9
"""Of the way from the first log point to the best setting."""


def _sensitive(data: Data, loss: str, field: str, much: bool, words: str, section: str) -> Claim:
    """App. C.3: a field moves the mean final return by more, or less, than a tenth of what training gains."""
    moved = {TASKS[task].title: spread(summary, loss, field) for task, summary in present(data).items()}
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
    for task, summary in present(data).items():
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
    gaps = {}
    for task, summary in present(data).items():
        ours = np.concatenate([finals(summary, loss) for loss in CLASSIFICATION])
        chance = probability_of_improvement([ours], [finals(summary, "gaussian")])
        gaps[TASKS[task].title] = Interval(*(bound - 0.5 for bound in chance))
    return Claim(
        "§5.1",
        "Classification is more robust to hyperparameters.",
        "chance that a run of HL-1-Hot or HL-Gauss, of any setting, ends above a run of the Gaussian, less ½",
        listed(gaps),
        verdict(gaps.values()),
        sorted_out(gaps),
        "figure-7",
    )


def higher_fraction(data: Data) -> Claim:
    """App. C.4, Figure 7."""
    gaps = {}
    for task, summary in present(data).items():
        start, end = progress(summary)
        if end > start:
            groups = [by_setting(summary, loss) for loss in ("gaussian", *CLASSIFICATION)]
            gaps[TASKS[task].title] = _more_above(start + _HIGH * (end - start), groups)
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


def _more_above(high: float, groups: Sequence[np.ndarray]) -> Interval:
    """How much greater a share the last groups have than the first, trials resampled within each setting."""
    ends = np.cumsum([len(group) for group in groups])[:-1]

    def more(settings: Sequence[np.ndarray]) -> float:
        shares = np.split((np.array(settings) > high).mean(1), ends)
        return float(np.mean([share.mean() for share in shares[1:]]) - shares[0].mean())

    return stratified_bootstrap([*np.concatenate(groups)], more, n_resamples=1000)
