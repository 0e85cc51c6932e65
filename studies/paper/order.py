"""What §7 says of the two classification losses against each other."""

import dataclasses
from collections.abc import Iterable

from galton.tasks import TASKS
from galton_experiments.analysis import Comparison, rounded, within
from galton_experiments.page import Claim
from galton_experiments.runs import Summary
from studies.paper.measures import Scores, final_return, versus
from studies.paper.prose import says
from studies.paper.scale import Scale
from studies.paper.trained import Trained
from studies.paper.verdicts import A_TENTH, UNKNOWN, Found, by_task, claim, marks, null, unit

_ONE_HOT = 0.1
"""η up to which HL-Gauss is HL-1-Hot: the own bin has 0.999999 of the mass or more."""


def order_changes(trained: Trained) -> Claim:
    """What §7 says: often little difference, and another order on other tasks."""
    orders: dict[str, Comparison] = {}

    def judge(task: str, scale: Scale) -> dict[str, Found]:
        again = trained.judged[task].again
        if again.best["hl-gauss"].setting["eta"] <= _ONE_HOT:
            return {"": null(f"the same loss: HL-Gauss's best η is at most {_ONE_HOT}")}

        def share(summary: Summary, loss: str) -> Scores:
            return scale.share(final_return(summary, loss))

        order = orders[TASKS[task].title] = versus(again, "hl-gauss", "hl-one-hot", share)
        alike = within(share(again, "hl-gauss"), share(again, "hl-one-hot"), A_TENTH, again.study.common_seeds)
        return {"": unit(alike, rounded(order.difference))}

    units = by_task(trained, trained.judged, judge)
    little = [mark for mark in marks(units).values() if mark in "✓✗≈"]
    ahead = marks(orders)
    told = claim(
        *says("order_changes"),
        units,
        f"HL-Gauss is clearly ahead: {_where(ahead, '✓')}. HL-1-Hot: {_where(ahead, '✗')}." if units else "",
    )
    return dataclasses.replace(told, verdict=_both(_often(little), _changes(ahead.values())), count=None)


def _both(*facts: bool | None) -> str:
    """The verdict on a claim of two facts, either of which may be open."""
    if all(fact is not None for fact in facts) and len({*facts}) == 1:
        return "holds" if facts[0] else "does not hold"
    return "holds in part" if True in facts else UNKNOWN


def _often(little: list[str]) -> bool | None:
    """Whether half of the tasks or more differ little.

    None where those that are open could decide it either way, or where there is but one.
    """
    if len(little) < 2:
        return None
    if 2 * little.count("✓") >= len(little):
        return True
    return False if 2 * little.count("✗") > len(little) else None


def _changes(ahead: Iterable[str]) -> bool | None:
    """Whether each loss is ahead somewhere; not so where one is wherever anything can be decided, on two tasks or more.

    None where it is open.
    """
    known = [mark for mark in ahead if mark in "✓✗≈"]
    if {"✓", "✗"} <= {*known}:
        return True
    return False if len(known) > 1 and len({*known}) == 1 and known[0] != "≈" else None


def _where(ahead: dict[str, str], mark: str) -> str:
    return ", ".join(task for task, found in ahead.items() if found == mark) or "nowhere"
