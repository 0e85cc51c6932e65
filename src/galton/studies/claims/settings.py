"""What the paper says of all settings together (Apps C.3 and C.4)."""

import numpy as np

from galton.analysis.page import Claim
from galton.analysis.statistics import Interval, probability_of_improvement
from galton.studies.base import Data, present
from galton.studies.claims.verdicts import NOT_TRAINED, UNKNOWN, decided, listed, sorted_out, verdict
from galton.studies.figure_7 import finals
from galton.studies.measures import CLASSIFICATION, spread
from galton.studies.sweeps import TASKS

_TENTH = 0.1


def _sensitive(data: Data, loss: str, field: str, much: bool, words: str, section: str) -> Claim:
    """App. C.3: a field moves the mean final return by more, or less, than a tenth of what training gains."""
    moved = {TASKS[task].title: spread(summary, loss, field) for task, summary in present(data).items()}
    known = decided({name: interval for name, interval in moved.items() if interval is not None})
    right = [bool(interval.low > _TENTH if much else interval.high < _TENTH) for interval in known.values()]
    held = "holds" if all(right) else "holds in part" if any(right) else "does not hold"
    where = [name for name, is_right in zip(known, right, strict=True) if is_right]
    return Claim(
        "App. C.3",
        words,
        "range of the marginal mean final returns, as a share of what training gains; a tenth divides sensitive from "
        "robust",
        listed(known, ".2f"),
        held if known else UNKNOWN,
        f"So on {', '.join(where) or 'no task'}." if known else NOT_TRAINED,
        section,
    )


def sensitivities(data: Data) -> list[Claim]:
    """App. C.3, Figures 4 to 6."""
    rate, k, eta = "learning_rate", "n_bins", "eta"
    return [
        _sensitive(data, "hl-gauss", rate, True, "HL-Gauss is sensitive to the learning rate.", "figure-4"),
        _sensitive(data, "hl-gauss", eta, True, "HL-Gauss is sensitive to η.", "figure-4"),
        _sensitive(data, "hl-gauss", k, False, "HL-Gauss is robust to the number of bins.", "figure-4"),
        _sensitive(data, "hl-one-hot", k, False, "HL-1-Hot is robust to the number of bins.", "figure-5"),
        _sensitive(data, "hl-one-hot", rate, True, "HL-1-Hot is sensitive to the learning rate.", "figure-5"),
        _sensitive(data, "gaussian", rate, True, "The Gaussian is sensitive to the learning rate.", "figure-6"),
    ]


def higher_fraction(data: Data) -> Claim:
    """App. C.4, Figure 7."""
    gaps = {}
    for task, summary in present(data).items():
        ours = np.concatenate([finals(summary, loss) for loss in CLASSIFICATION])
        chance = probability_of_improvement([ours], [finals(summary, "gaussian")])
        gaps[TASKS[task].title] = Interval(*(bound - 0.5 for bound in chance))
    return Claim(
        "App. C.4",
        "Over all settings, a higher fraction of classification's runs reaches a high return.",
        "chance that a run of HL-1-Hot or HL-Gauss ends above a run of the Gaussian, less ½",
        listed(gaps),
        verdict(gaps.values()),
        sorted_out(gaps),
        "figure-7",
    )
