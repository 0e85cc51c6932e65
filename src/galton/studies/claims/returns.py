"""What the paper says of returns on its seven tasks (abstract, §1, §5.2.1, §7)."""

import math
from collections.abc import Iterable, Sequence

import numpy as np

from galton.analysis.page import Claim
from galton.analysis.statistics import Interval, difference_interval, stratified_bootstrap
from galton.studies.base import Data, present
from galton.studies.claims.verdicts import UNKNOWN, decided, listed, sorted_out, verdict
from galton.studies.measures import better_classification, final_return, winner
from galton.studies.sweeps import TASKS


def _against_regression(data: Data, score: str, tasks: Iterable[str]) -> dict[str, Interval]:
    return {TASKS[task].title: better_classification(data, task, score)[1] for task in tasks}


def ends_higher(data: Data) -> Claim:
    """§5.2.1, the main result."""
    gaps = _against_regression(data, "final", [task for task in present(data) if task != "acrobot"])
    return Claim(
        "Abstract, §5.2.1",
        "Classification reaches a higher return at the end of training, in almost all instances but Acrobot.",
        "final training return on fresh seeds: better of HL-1-Hot and HL-Gauss − Gaussian",
        listed(gaps),
        verdict(gaps.values()),
        sorted_out(gaps),
        "figure-2",
    )


def learns_faster(data: Data) -> Claim:
    """§5.2.1, data efficiency."""
    gaps = _against_regression(data, "speed", [task for task in present(data) if task != "acrobot"])
    return Claim(
        "Abstract, §5.2.1",
        "Classification learns faster, in almost all instances but Acrobot.",
        "training return averaged over all of training, on fresh seeds: better of the two − Gaussian",
        listed(gaps),
        verdict(gaps.values()),
        sorted_out(gaps),
        "figure-2",
    )


def acrobot(data: Data) -> Claim:
    """§5.2.1, the exception."""
    gains = _against_regression(data, "final", present(data, ("acrobot",)))
    gaps = {name: Interval(-gain.mean, -gain.high, -gain.low) for name, gain in gains.items()}
    return Claim(
        "§5.2.1",
        "On Acrobot regression outperforms classification.",
        "final training return on fresh seeds: Gaussian − better of HL-1-Hot and HL-Gauss",
        listed(gaps),
        verdict(gaps.values()),
        sorted_out(gaps),
        "figure-9",
    )


def more_stable(data: Data) -> Claim:
    """§1, contribution 4."""
    gaps = {}
    for task in present(data):
        summary, (best, _) = winner(data, task), better_classification(data, task)
        scores = [final_return(summary, loss) for loss in ("gaussian", best)]
        gaps[TASKS[task].title] = stratified_bootstrap(scores, _calm)
    return Claim(
        "§1",
        "Classification learns more stably.",
        "standard deviation of the final training return between seeds: log₂(Gaussian ÷ better classification)",
        listed(gaps),
        verdict(gaps.values()),
        sorted_out(gaps),
        "figure-2",
    )


def _calm(scores: Sequence[np.ndarray]) -> float:
    """By how many powers of two the first spread wider than the second."""
    first, second = (max(float(score.std(ddof=1)), 1e-12) for score in scores)
    return math.log2(first / second)


def order_changes(data: Data) -> Claim:
    """§7."""
    gaps = {
        TASKS[task].title: difference_interval(
            final_return(winner(data, task), "hl-gauss"),
            final_return(winner(data, task), "hl-one-hot"),
        )
        for task in present(data)
    }
    signs = {bool(gap.mean > 0) for gap in gaps.values() if gap.low > 0 or gap.high < 0}
    return Claim(
        "§7",
        "HL-1-Hot and HL-Gauss often differ little, and which is better changes across tasks.",
        "final training return on fresh seeds: HL-Gauss − HL-1-Hot",
        listed(gaps),
        UNKNOWN if len(decided(gaps)) < 2 else "holds" if len(signs) != 1 else "holds in part",
        sorted_out(gaps),
        "figure-2",
    )
