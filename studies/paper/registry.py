"""The figures of the page by name, and the sweeps that they need."""

from galton.errors import require
from studies.paper import bandit, hypotheses, one_step, profiles, propositions, rescaling, returns, sensitivity, why
from studies.paper.figure import FigureStudy
from studies.paper.sweeps import Sweep, needed

FIGURES: dict[str, FigureStudy] = {
    "figure-1": one_step.FIGURE,
    "figure-2": returns.TRAINING,
    "figure-3": bandit.FIGURE,
    "figure-3-boxed": rescaling.BOXED,
    "figure-4": sensitivity.HL_GAUSS,
    "figure-5": sensitivity.HL_ONE_HOT,
    "figure-6": sensitivity.GAUSSIAN,
    "figure-7": profiles.FIGURE,
    "figure-8": returns.EVALUATION,
    "figure-9": returns.IN_THE_APPENDIX,
    propositions.NAME: propositions.FIGURE,
    "why": why.FIGURE,
    hypotheses.NAME: hypotheses.FIGURE,
}
"""The figures by name, in the order of the page.

A study of your own is one more entry: its sweeps are trained, and its figure and table stand on the page, as the
others' do. What it says is one more of claims.CLAIMS.
"""


def all_sweeps() -> dict[str, Sweep]:
    """Every sweep, by name, that a figure needs, and those whose winners these train.

    Raises:
        UsageError: two of them, or one and what a figure measures, have one name, and so would have one file.
    """
    found: dict[str, Sweep] = {}
    for name, figure in FIGURES.items():
        for sweep in needed(figure.sweeps):
            known = found.setdefault(sweep.name, sweep)
            require(known == sweep, f"sweep {sweep.name!r} of {name} is another than that of a figure before it")
    for name, figure in FIGURES.items():
        is_free = figure.measure is None or name not in found
        require(is_free, f"{name!r} is a sweep, and a figure that measures something; give one of them another name")
    return found
