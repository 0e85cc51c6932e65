"""Hypothesis (a): the bandit whose actions are in units of its box, and all of Figure 3 again."""

import functools

from galton_experiments.page import Cell, Claim, Matrix
from galton_experiments.sweep import Study
from studies.paper import bandit
from studies.paper.claims import of_figure
from studies.paper.figure import figure
from studies.paper.sweeps import Budget, Done, Sweep, with_constants
from studies.paper.trained import Trained

_PREFIX = "boxed-"
_UNITS = ("raw units", "units of the box")
_HALF_WIDTH = 10.0
"""Of the bandit's box: actions in [−1, 1] are a tenth of its own."""


@functools.cache
def _boxed(raw: Sweep) -> Sweep:
    """The same sweep where the policy acts in [−1, 1]."""

    def study(budget: Budget, done: Done) -> Study:
        return with_constants(raw.study(budget, _without_prefix(done)), {"action_scale": 1 / _HALF_WIDTH})

    before = None if raw.winners_of is None else _boxed(raw.winners_of)
    return Sweep(_PREFIX + raw.name, study, winners_of=before)


def _without_prefix(done: Done) -> Done:
    return {name.removeprefix(_PREFIX): of for name, of in done.items() if name.startswith(_PREFIX)}


SWEEPS = tuple(map(_boxed, bandit.FIGURE.sweeps))
"""The sweeps of Figure 3, in units of the box."""


def in_the_box(trained: Trained) -> Trained:
    """The bandit in units of its box, in the place of the bandit."""
    return Trained(_without_prefix(trained.sweeps))


@functools.lru_cache(maxsize=1)  # the page and tables.md have it
def table(trained: Trained) -> Matrix:
    """What the paper says of Figure 3, judged in both units."""
    sides = trained, in_the_box(trained)
    if not sides[1].sweeps:
        return Matrix("the bandit", _UNITS, {})
    judged = [[judge(side) for judge in of_figure("figure-3")] for side in sides]
    rows = {pair[0].words: [cell(claim) for claim in pair] for pair in zip(*judged, strict=True)}
    return Matrix("the bandit", _UNITS, rows)


def cell(claim: Claim) -> Cell:
    """How many decisions of a claim are clearly as the paper says, of how many, and how many the contrary."""
    if claim.count is None:
        return Cell("—")
    contrary = sum(line.startswith("✗") for line in claim.number.splitlines())
    told = "{} of {}".format(*claim.count)
    return Cell(f"{told}, {contrary} contrary" if contrary else told, claim.verdict)


FIGURE = figure("figure-3-boxed", lambda trained: bandit.draw(in_the_box(trained)), SWEEPS, table=table)
