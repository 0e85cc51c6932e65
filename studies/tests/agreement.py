"""The text of a claim of the page is compared with what the second path found (see `recomputed`)."""

import math
import re

from studies.paper import controls, harder_bandits, order, returns
from studies.paper.claims import CLAIMS
from studies.paper.trained import Trained

from .recomputed.bandits import BANDITS
from .recomputed.claims import GRIDS, TASKS, on_grids, on_tasks
from .recomputed.claims import order as order_of
from .recomputed.runs import grids_of, tasks_of

MODULES = (returns, order, harder_bandits, controls)
NUMBER = re.compile(r"never|[+−]?\d[\d,]*\.?\d*")


JUDGES = [judge for _, judge in CLAIMS]
NAMES = (*TASKS, "order_changes", *BANDITS, *GRIDS)
"""Every claim that both paths judge, by its function's name or by its words."""


def judge_of(name):
    """The function that judges a claim for the page."""
    if name in GRIDS:
        return next(judge for judge in JUDGES if judge(Trained({})).words == name)
    return next(getattr(module, name) for module in MODULES if hasattr(module, name))


def found_again(name, sweeps):
    """The same claim by the second path."""
    if name in GRIDS:
        return on_grids(grids_of(sweeps), name)
    if name in BANDITS:
        return BANDITS[name](sweeps)
    return order_of(tasks_of(sweeps)) if name == "order_changes" else on_tasks(tasks_of(sweeps), name)[0]


def is_printed(text, value):
    """Say whether a number is printed as this text."""
    if text == "never":
        return math.isinf(value)
    plain = text.replace("−", "-").replace(",", "")
    decimals = len(plain.partition(".")[2])
    return abs(float(plain) - value) <= 0.5 * 10**-decimals * (1 + 1e-6) + 1e-9


def assert_prints(line, found, mark, p):
    """A line of a claim has this mark, name, numbers and p."""
    assert line.startswith(f"{mark} {found.name} ")
    told = line.removeprefix(f"{mark} {found.name} ")
    if found.null:
        assert told == found.null
        return
    values = [x for number in found.numbers for x in (number if isinstance(number, tuple) else (number,))]
    disagrees = not math.isnan(p) and p < 0.05 and found.sign == 0
    assert told.endswith("; the mean points the other way") == disagrees, line
    texts = NUMBER.findall(told)
    if not math.isnan(p):
        assert p < 0.001 if texts[-1] == "0.001" and "p < " in told else is_printed(texts[-1], p)
        texts = texts[:-1]
    assert len(texts) == len(values), line
    assert all(map(is_printed, texts, values)), (line, values)


def assert_same(claim, found):
    """The page and the second path agree on a claim."""
    assert (claim.verdict, claim.count) == (found.verdict, found.count)
    lines = claim.number.splitlines()
    assert len(lines) == len(found.found)
    for line, each, mark, p in zip(lines, found.found, found.marks, found.adjusted, strict=True):
        assert_prints(line, each, mark, p)


def agreed(name, trained, sweeps):
    """The page's claim, on which the second path agrees."""
    claim = judge_of(name)(trained)
    assert_same(claim, found_again(name, sweeps))
    return claim
