"""Comparisons become verdicts on the paper's claims, and get words for them."""

import math
from collections.abc import Callable, Iterable, Mapping
from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from galton.tasks import TASKS
from galton_experiments.analysis import ALPHA, Comparison, Decision, decide, mean_interval, rounded
from galton_experiments.page import MARKS, Claim
from studies.paper.trained import Scale, Trained

UNKNOWN = "not decidable here"
NOT_TRAINED = "What it needs was not trained."
A_TENTH = 0.1
"""The share of the way from rest to the best below which a difference is called little."""


class Unit(NamedTuple):
    """One of the decisions that a claim rests on: a task, a loss, or both."""

    text: str
    """The numbers that were found, as the line of this decision shows them."""
    p: float
    """Of the test that there is no difference, not adjusted; NaN where nothing can be decided."""
    direction: int
    """The direction in which it points: 1 as the paper says, −1 the contrary."""
    is_null: bool = False
    """True if the task is one on which nothing is learned."""


Found = Comparison | Unit


def unit(found: Comparison, text: str | None = None) -> Unit:
    """A comparison as one of a claim's decisions, and what is told of it instead of difference and P."""
    return Unit(told(found) if text is None else text, found.p, found.direction)


def null(why: str) -> Unit:
    """A task on which nothing is learned, and so nothing compared."""
    return Unit(why, math.nan, 0, is_null=True)


def by_task(
    trained: Trained, tasks: Iterable[str], judge: Callable[[str, Scale], Mapping[str, Found]]
) -> dict[str, Found]:
    """The units of each task, by its title and what `judge` calls them ("" where there is one); null tasks as such."""
    found: dict[str, Found] = {}
    for task in tasks:
        title = TASKS[task].title
        if task in trained.scales:
            units = judge(task, trained.scales[task])
            found |= {f"{title} {name}".strip(): each for name, each in units.items()}
        else:
            found[title] = null(trained.nulls[task])
    return found


def told_mean(values: Float[np.ndarray, " n"]) -> str:
    """The mean of runs with its interval."""
    return rounded(mean_interval(values), "")


def told(found: Comparison) -> str:
    """The difference with its interval, and P(X > Y)."""
    return f"{rounded(found.difference)}, P = {found.above:.2f}"


def decided(units: Mapping[str, Found], unless_contrary: bool = False) -> dict[str, Decision]:
    """Decide each unit, all adjusted together; ∅ of a task on which nothing is learned.

    `unless_contrary` is for what claims no more than that nothing is clearly the contrary: all else is ✓.
    """
    known = _units(units)
    found = decide(known)
    found |= {name: found[name]._replace(mark="∅") for name, each in known.items() if each.is_null}
    return {n: d._replace(mark="✓" if unless_contrary and d.mark == "≈" else d.mark) for n, d in found.items()}


def marks(units: Mapping[str, Found]) -> dict[str, str]:
    """The mark of each unit."""
    return {name: decision.mark for name, decision in decided(units).items()}


def claim(
    source: str, words: str, test: str, units: Mapping[str, Found], *notes: str, unless_contrary: bool = False
) -> Claim:
    """A sentence of the paper, judged by units that it says are positive; none where nothing was trained.

    Notes are further sentences, each on a line of its own. For `unless_contrary` see `decided`.
    """
    given = decided(units, unless_contrary)
    k, m, n = (sum(each.mark in which for each in given.values()) for which in ("✓", "✗", "✓✗≈"))
    why = "\n".join([_counted(k, m, n), *filter(None, notes)]) if units else NOT_TRAINED
    count = (k, n) if n else None
    return Claim(source, words, test, listed(units, given), verdict(k, m, n), why, count=count)


def verdict(k: int, m: int, n: int) -> str:
    """The verdict of n units that can be decided, k of them clearly as the paper says and m clearly the contrary."""
    if k == m == 0:
        return UNKNOWN
    return "holds" if k == n else "holds in part" if k >= m else "does not hold"


def listed(units: Mapping[str, Found], given: Mapping[str, Decision]) -> str:
    """A line for each unit: its mark, name, what was found, and p, adjusted; and whether the mean contradicts it."""
    lines = []
    for (name, each), (mark, p) in zip(_units(units).items(), given.values(), strict=True):
        against = "; the mean points the other way" * (each.direction == 0 and p < ALPHA)
        lines.append(f"{mark} {name} {each.text}{_p(p)}{against}")
    return "\n".join(lines)


def summed_up(what: str, units: Mapping[str, Found]) -> str:
    """A sentence on further decisions, adjusted among themselves, that a claim notes without counting them."""
    given = marks(units)
    words = [
        f"{len(names)} {word} ({', '.join(names)})"
        for mark, word in MARKS.items()
        if (names := [name for name, found in given.items() if found == mark])
    ]
    return f"{what}: {'; '.join(words)}." if words else ""


def _units(units: Mapping[str, Found]) -> dict[str, Unit]:
    return {name: each if isinstance(each, Unit) else unit(each) for name, each in units.items()}


def _counted(k: int, m: int, n: int) -> str:
    if not n:
        return "Nothing can be decided."
    contrary = f", {m} clearly the contrary" if m else ""
    return f"{k} of {n} as the paper says{contrary}."


def _p(p: float) -> str:
    if math.isnan(p):
        return ""
    return ", p < 0.001" if p < 0.001 else f", p = {p:.3f}" if p < ALPHA else f", p = {p:.2f}"
