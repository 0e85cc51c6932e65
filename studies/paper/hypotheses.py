"""The same claims are judged where one thing is changed, to find what makes the paper's result appear."""

import functools
from collections.abc import Iterable, Iterator

from galton.tasks import TASKS
from galton_experiments.page import Cell, Matrix
from galton_experiments.runs import Summary
from studies.paper import changes, rescaling, returns, why
from studies.paper.changes import Variant
from studies.paper.claims import Judge
from studies.paper.figure import figure
from studies.paper.prose import text
from studies.paper.sweeps import AGAIN, MAIN
from studies.paper.trained import Judged, Trained

CLAIMS: dict[str, Judge] = {
    "ends higher": returns.ends_higher,
    "ends higher, deterministic": returns.ends_higher_without_noise,
    "learns faster": returns.learns_faster,
    "learns sooner": returns.learns_sooner,
    "Acrobot is the exception": returns.acrobot,
}
"""The claims that changes are to move: what the page calls them, and what judges them."""
NAME = "hypotheses"
_VARIANTS: dict[str, Iterable[Variant]] = {
    "b": rescaling.VARIANTS,
    **{letter: [change.variant for change in of] for letter, of in changes.CHANGES.items()},
    "h": [changes.WITHOUT_LOWEST],
}


def rows(trained: Trained) -> Iterator[tuple[str, Trained]]:
    """The main experiment, then every change, each with what was trained as if the main experiment had been this."""
    yield "as in the main experiment", trained
    yield "(a) bandit in units of its box", rescaling.in_the_box(trained)
    for letter, variants in _VARIANTS.items():
        for variant in variants:
            yield f"({letter}) {variant.name}", under(trained, variant)
    for variant in why.variants():
        yield variant.name, under(trained, variant)


@functools.lru_cache(maxsize=1)  # the page and tables.md have it
def table(trained: Trained) -> Matrix:
    """Change × claim: of how many tasks each holds."""
    found = {name: each for name, each in rows(trained) if each.judged}
    cells = {}
    for name, each in found.items():
        tasks = "all" if len(each.judged) == len(TASKS) else ", ".join(map(each.title, each.judged))
        cells[name] = [Cell(tasks), *(rescaling.cell(judge(each)) for judge in CLAIMS.values())]
    return Matrix("change", ["tasks", *CLAIMS], cells, heads=_heads(found))


def _heads(names: Iterable[str]) -> dict[str, tuple[str, str]]:
    """Return each hypothesis's title and text, to stand above its first row; an earlier study's come last."""
    firsts: dict[str, str] = {}
    for name in names:
        firsts.setdefault(name[1] if name.startswith("(") else "why" if why.CHANGES.get(name) else "", name)
    told = text("hypotheses")
    return {name: (told[group]["title"], told[group]["text"]) for group, name in firsts.items() if group}


def under(trained: Trained, variant: Variant) -> Trained:
    """Return what was trained, with a variant in the place of the main experiment, on the tasks where it was made.

    The losses that it leaves alone are the main experiment's.
    """
    found: dict[str, Summary] = {}
    for task, (choosing, judging) in variant.sweeps.items():
        chosen, again, main = trained.of(choosing), trained.of(judging), trained.judged.get(task)
        if chosen is None or again is None or main is None or not (winners := variant.winners(task, chosen, again)):
            continue
        own = Judged(chosen.part([*winners]), again.part([*winners.values()]))
        losses = variant.losses or [setting["loss"] for setting in winners]
        others = [best.setting for loss, best in main.again.best.items() if loss not in losses]
        if others:
            own = Judged(*(each.joined(of.part(others)) for each, of in zip(own, main, strict=True)))
        found |= {MAIN[task].name: own.chosen, AGAIN[task].name: own.again}
    return Trained(found)


FIGURE = figure(
    NAME,
    rescaling.draw,
    (
        *(sweep for key in changes.SWEEPS for sweep in (changes.SWEEPS[key], changes.AGAIN[key])),
        *rescaling.SWEEPS.values(),
        *(again for _, again in changes.WITHOUT_LOWEST.sweeps.values()),
    ),
    table=table,
)
