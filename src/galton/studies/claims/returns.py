"""What the paper says of returns on its seven tasks (abstract, §1, §5.2.1, §7)."""

import functools
import math
from collections.abc import Callable, Iterable

import numpy as np

from galton.analysis.page import Claim
from galton.analysis.statistics import Interval, difference_interval, mean_interval
from galton.losses import LOSSES
from galton.studies.base import Data
from galton.studies.claims.verdicts import A_TENTH, NOT_TRAINED, UNKNOWN, decided, listed, named, sorted_out, verdict
from galton.studies.measures import (
    CLASSIFICATION,
    Judged,
    Scores,
    better,
    final_return,
    judged,
    mean_return,
    over_regression,
    progress,
)
from galton.studies.summary import Summary
from galton.tasks import TASKS

_ONE_HOT = 0.1
"""η up to which HL-Gauss is HL-1-Hot: the own bin has 0.999999 of the mass or more."""


def _against_regression(
    data: Data, score: Callable[[Summary, str], Scores]
) -> tuple[dict[str, Interval], dict[str, Judged]]:
    """By title, on all tasks but the paper's exception; and these tasks."""
    tasks = judged(data, tuple(task for task in TASKS if task != "acrobot"))
    return {TASKS[name].title: over_regression(task, score) for name, task in tasks.items()}, tasks


def _idle(tasks: dict[str, Judged]) -> str:
    """Which of the paper's losses do not clearly learn to do better than nothing."""
    found = []
    for name, task in tasks.items():
        finals = {loss: mean_interval(final_return(task.again, loss)) for loss in ("gaussian", *CLASSIFICATION)}
        rest = TASKS[name].at_rest
        idle = [LOSSES[loss].label for loss, final in finals.items() if rest is not None and final.low <= rest]
        if idle:
            found.append(f"{TASKS[name].title} ({', '.join(idle)})")
    return f"Not clearly above what doing nothing earns: {', '.join(found)}." if found else ""


def _without_noise(data: Data, score: Callable[..., Scores]) -> str:
    """The same of the deterministic policy, which does not pay for exploration."""
    gaps, _ = _against_regression(data, functools.partial(score, metric="evaluation_return"))
    return f"By the deterministic policy's return (Figure 8), {named(gaps)}." if gaps else ""


def _entropies(tasks: dict[str, Judged], gaps: dict[str, Interval]) -> str:
    """How much the better softmax still explores in the end, where it is the worse policy."""
    ends = []
    for name, task in tasks.items():
        if gaps[TASKS[name].title].high < 0:
            setting = task.again.best[better(task.chosen, final_return)].setting
            entropy = mean_interval(task.again.final("entropy")[task.again.rows(setting)]).mean
            uniform = TASKS[name].d * math.log(setting.config.n_bins)
            ends.append(f"{TASKS[name].title} {entropy:.1f} of {uniform:.1f} nats")
    return f"The softmax's final entropy where it ends lower: {', '.join(ends)}." if ends else ""


def ends_higher(data: Data) -> Claim:
    """§5.2.1, the main result."""
    gaps, tasks = _against_regression(data, final_return)
    return Claim(
        "§1, §5.2.1",
        "In almost all instances classification reaches a higher return at the end of training. (Acrobot is an "
        "exception.)",
        "final training return on fresh seeds, the classification loss that was better on the grid − Gaussian",
        listed(gaps),
        verdict(gaps.values()),
        sorted_out(gaps, _without_noise(data, final_return), _entropies(tasks, gaps), _idle(tasks)),
        "figure-2",
    )


def learns_faster(data: Data) -> Claim:
    """§5.2.1, data efficiency."""
    gaps, _ = _against_regression(data, mean_return)
    return Claim(
        "Abstract, §5.2.1",
        "In almost all instances classification learns faster. (Acrobot is an exception.)",
        "training return averaged over all of training, on fresh seeds, the classification loss that was better on "
        "the grid − Gaussian",
        listed(gaps),
        verdict(gaps.values()),
        sorted_out(gaps, _without_noise(data, mean_return)),
        "figure-2",
    )


def acrobot(data: Data) -> Claim:
    """§5.2.1, the exception."""
    tasks = judged(data, ("acrobot",))
    gains = {TASKS[name].title: over_regression(task) for name, task in tasks.items()}
    gaps = {name: Interval(-gain.mean, -gain.high, -gain.low) for name, gain in gains.items()}
    return Claim(
        "§5.2.1",
        "On Acrobot regression outperforms classification.",
        "final training return on fresh seeds, Gaussian − the classification loss that was better on the grid",
        listed(gaps),
        verdict(gaps.values()),
        sorted_out(gaps, _entropies(tasks, gains), _idle(tasks)),
        "figure-9",
    )


def more_stable(data: Data) -> Claim:
    """§1, contribution 4."""
    tasks = judged(data)
    gaps = {}
    for name, task in tasks.items():
        losses = "gaussian", better(task.chosen, final_return)
        scores = [final_return(task.again, loss) for loss in losses]
        gaps[TASKS[name].title] = difference_interval(*(np.abs(score - np.median(score)) for score in scores))
    return Claim(
        "§1",
        "Classification learns more stably.",
        "how far seeds end from their median, in training return: Gaussian − the classification loss that was better "
        "on the grid (Brown and Forsythe's comparison of spreads)",
        listed(gaps),
        verdict(gaps.values()),
        sorted_out(gaps),
        "figure-2",
    )


def order_changes(data: Data) -> Claim:
    """§7."""
    gaps = {}
    for name, task in judged(data).items():
        start, end = progress(task.chosen)
        gap = difference_interval(*(final_return(task.again, loss) for loss in ("hl-gauss", "hl-one-hot")))
        if end > start:
            gaps[TASKS[name].title] = Interval(*(bound / (end - start) for bound in gap))
    known = decided(gaps)
    little = [name for name, gap in known.items() if gap.low > -A_TENTH and gap.high < A_TENTH]
    ahead = {
        "hl-gauss": [name for name, gap in known.items() if gap.low > 0],
        "hl-one-hot": [name for name, gap in known.items() if gap.high < 0],
    }
    same = [
        TASKS[name].title
        for name, task in judged(data).items()
        if TASKS[name].title in known and task.again.best["hl-gauss"].setting.hypers.eta <= _ONE_HOT
    ]
    facts = [2 * len(little) >= len(known), all(ahead.values())]
    held = "holds" if all(facts) else "holds in part" if any(facts) else "does not hold"
    return Claim(
        "§7",
        "HL-1-Hot and HL-Gauss often differ little, and which is better changes across tasks.",
        "final training return on fresh seeds, HL-Gauss − HL-1-Hot, as a share of what training gains; often is on "
        "half of the tasks, little within a tenth",
        listed(gaps),
        held if len(known) > 1 else UNKNOWN,
        "\n".join(
            [
                f"Little: {_names(little)}.",
                *(f"{LOSSES[loss].label} ahead: {_names(on)}." for loss, on in ahead.items()),
                *([f"On {_names(same)} the best η is at most {_ONE_HOT}, which is HL-1-Hot."] if same else []),
            ]
        )
        if gaps
        else NOT_TRAINED,
        "figure-2",
    )


def _names(tasks: Iterable[str]) -> str:
    return ", ".join(tasks) or "nowhere"
