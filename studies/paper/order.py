"""§1's claims of stability between seeds and in a run, and §7's of the order of classification losses, are judged."""

import dataclasses
from collections.abc import Iterable

import numpy as np

from galton.tasks import TASKS
from galton_experiments.analysis import Comparison, rounded, within
from galton_experiments.page import Claim
from galton_experiments.runs import Summary
from studies.paper.measures import Scores, apart, better, drawdown, final_return, versus
from studies.paper.prose import says
from studies.paper.trained import Scale, Trained
from studies.paper.verdicts import A_TENTH, UNKNOWN, Found, by_task, claim, marks, null, told_mean, unit

_ONE_HOT = 0.1
"""η up to which HL-Gauss is HL-1-Hot: the own bin has 0.999999 of the mass or more."""


def order_changes(trained: Trained) -> Claim:
    """Judge what §7 says: often little difference, and another order on other tasks."""
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
    """True if half of the tasks or more differ little; None where open ones could decide it, or where there is one."""
    if len(little) > 1 and 2 * little.count("✓") >= len(little):
        return True
    return False if len(little) > 1 and 2 * little.count("✗") > len(little) else None


def _changes(ahead: Iterable[str]) -> bool | None:
    """True if each loss is ahead somewhere; None where it is open.

    Not so where one is wherever anything can be decided, on two tasks or more.
    """
    known = [mark for mark in ahead if mark in "✓✗≈"]
    if {"✓", "✗"} <= {*known}:
        return True
    return False if len(known) > 1 and len({*known}) == 1 and known[0] != "≈" else None


def _where(ahead: dict[str, str], mark: str) -> str:
    return ", ".join(task for task, found in ahead.items() if found == mark) or "nowhere"


def alike_between_seeds(trained: Trained) -> Claim:
    """The fourth contribution of §1, between runs: how far seeds end from one another."""

    def judge(task: str, scale: Scale) -> dict[str, Found]:
        chosen, again = trained.judged[task]
        ours = better(chosen, final_return)
        found = versus(again, "gaussian", ours, apart)
        typical = (np.median(apart(again, loss)) / (scale.best - scale.rest) for loss in ("gaussian", ours))
        return {"": unit(found, "{:.3f} and {:.3f}, P = ".format(*typical) + f"{found.above:.2f}")}

    return claim(*says("alike_between_seeds"), by_task(trained, trained.judged, judge))


def keeps_what_it_learns(trained: Trained) -> Claim:
    """The fourth contribution of §1, within a run: what is lost again of what had been reached."""

    def judge(task: str, scale: Scale) -> dict[str, Found]:
        chosen, again = trained.judged[task]
        ours = better(chosen, final_return)
        found = versus(again, "gaussian", ours, lambda summary, loss: drawdown(summary, loss, scale))
        lost = (told_mean(drawdown(again, loss, scale)) for loss in ("gaussian", ours))
        return {"": unit(found, f"{' and '.join(lost)}, P = {found.above:.2f}")}

    return claim(*says("keeps_what_it_learns"), by_task(trained, trained.judged, judge))
