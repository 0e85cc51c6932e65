"""What makes the paper's result appear? The same claims, judged where one thing is changed."""

import functools
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping
from typing import NamedTuple

from galton.tasks import TASKS
from galton_experiments.page import Cell, Claim, Matrix
from studies.paper import changes, rescaling, returns, why
from studies.paper.boxed import cell, in_the_box
from studies.paper.changes import HYPOTHESES, Change
from studies.paper.figure import FigureStudy
from studies.paper.rescaling import SCALES
from studies.paper.sweeps import AGAIN, MAIN, Sweep
from studies.paper.trained import Judged, Trained

CLAIMS: dict[str, Callable[[Trained], Claim]] = {
    "ends higher": returns.ends_higher,
    "ends higher, deterministic": returns.ends_higher_without_noise,
    "learns faster": returns.learns_faster,
    "learns sooner": returns.learns_sooner,
    "Acrobot is the exception": returns.acrobot,
}
"""The claims that changes are to move: what the page calls them, and what judges them."""


NAME = "hypotheses"


class Row(NamedTuple):
    """One line of the table: a change, and what was trained under it."""

    name: str
    trained: Trained
    """As if the main experiment had been this."""


def rows(trained: Trained) -> Iterator[Row]:
    """The main experiment, then every change under which something was trained."""
    yield Row("as in the main experiment", trained)
    for letter, hypothesis in HYPOTHESES.items():
        for change in hypothesis.changes:
            yield Row(f"({letter}) {change.name}", under(trained, change))
        own = _OWN.get(letter)
        for name, found in own(trained) if own else ():
            yield Row(f"({letter}) {name}", found)
    for name in filter(why.CHANGES.get, why.CHANGES):
        yield Row(name, as_before(trained, name))


def _of_scales(trained: Trained) -> Iterator[tuple[str, Trained]]:
    for scale in SCALES:
        if scale != 1:
            yield f"action box × {scale:g}", rescaled(trained, scale, in_box=False)
    yield f"× {SCALES[-1]:g}, the Gaussian in units of the box", rescaled(trained, SCALES[-1], in_box=True)


_OWN: dict[str, Callable[[Trained], Iterable[tuple[str, Trained]]]] = {
    "a": lambda trained: [("bandit in units of its box", in_the_box(trained))],
    "b": _of_scales,
    "h": lambda trained: [("MuJoCo without the learning rate 1e-4", without_lowest(trained))],
}
"""The rows of the hypotheses that have sweeps of their own."""


@functools.lru_cache(maxsize=1)  # the page and tables.md have it
def table(trained: Trained) -> Matrix:
    """Change × claim: of how many tasks each holds."""
    found = {row.name: row.trained for row in rows(trained) if row.trained.judged}
    return Matrix(
        "change",
        ["tasks", *CLAIMS],
        {name: [Cell(_tasks(each)), *(cell(judge(each)) for judge in CLAIMS.values())] for name, each in found.items()},
        heads=_heads(found),
    )


def _heads(names: Iterable[str]) -> dict[str, tuple[str, str]]:
    """What each hypothesis says, above the first of its rows; an earlier study's come last."""
    firsts: dict[str, str] = {}
    for name in names:
        firsts.setdefault(name[1] if name.startswith("(") else _EARLIER if why.CHANGES.get(name) else "", name)
    told = {letter: (f"({letter}) {each.title}.", each.told) for letter, each in HYPOTHESES.items()} | {_EARLIER: _WHY}
    return {name: told[group] for group, name in firsts.items() if group in told}


_EARLIER = "why"
_WHY = ("The earlier study, why.", "Three tasks, five runs of each loss on fresh seeds: it can show little.")


def _tasks(trained: Trained) -> str:
    if len(trained.judged) == len(TASKS):
        return "all"
    return ", ".join(TASKS[task].title + (" (null)" if task in trained.nulls else "") for task in trained.judged)


def under(trained: Trained, change: Change) -> Trained:
    """What was trained, with the change in the place of the main experiment, on the tasks where it was made.

    The losses that it leaves alone are the main experiment's.
    """
    found: dict[str, Judged] = {}
    for task in change.tasks:
        pair = _pair(trained, changes.SWEEPS[task, change.ground], changes.AGAIN[task, change.ground])
        if pair is not None and task in trained.judged:
            winners = changes.best_under(pair.chosen, change, task, pair.chosen.provenance["budget"])
            found[task] = _beside(
                Judged(*(each.part([*winners.values()]) for each in pair)), trained.judged[task], change.losses
            )
    return as_main(found)


def rescaled(trained: Trained, scale: float, in_box: bool) -> Trained:
    """The tasks with their action box times the scale, the Gaussian in units of the action or of the box."""
    found: dict[str, Judged] = {}
    for task in rescaling.SCALE_TASKS:
        done = trained.of(rescaling.SWEEPS[task, scale])
        if done is not None and task in trained.judged:
            other = "gaussian" if in_box else rescaling.IN_THE_BOX
            settings = [setting for setting in done.study.settings if rescaling.name_of(setting) != other]
            losses = {setting["loss"] for setting in settings}
            best = trained.judged[task].chosen.best
            chosen = trained.judged[task].chosen.part([best[loss].setting for loss in best if loss in losses])
            found[task] = Judged(chosen, done.part(settings))
    return as_main(found)


def without_lowest(trained: Trained) -> Trained:
    """MuJoCo's grids without their lowest learning rate."""
    found: dict[str, Judged] = {}
    for task, sweep in changes.WITHOUT_LOWEST.items():
        done = trained.of(sweep)
        if done is not None and task in trained.judged:
            main = trained.judged[task]
            winners = changes.best_without_lowest(main.chosen)
            new = [setting for setting in winners.values() if setting in done.study.settings]
            changed = [setting["loss"] for setting in new]
            found[task] = _beside(Judged(main.chosen.part(new), done.part(new)), main, changed)
    return as_main(found)


def as_before(trained: Trained, name: str) -> Trained:
    """The winners of `why` under one of its changes."""
    found: dict[str, Judged] = {}
    for task, sweep in why.SWEEPS.items():
        pair = _pair(trained, sweep, why.AGAIN[task])
        if pair is not None:
            own = [setting for setting in pair.again.study.settings if why.change_of(setting, TASKS[task].env) == name]
            found |= {task: Judged(*(each.part(own) for each in pair))} if own else {}
    return as_main(found)


def _pair(trained: Trained, sweep: Sweep, again: Sweep) -> Judged | None:
    chosen, judged = trained.of(sweep), trained.of(again)
    return Judged(chosen, judged) if chosen is not None and judged is not None else None


def _beside(own: Judged, main: Judged, changed: Collection[str]) -> Judged:
    """The winners under a change, and those of the main experiment of the losses that were not changed."""
    others = [best.setting for loss, best in main.again.best.items() if loss not in changed]
    return Judged(*(each.joined(of.part(others)) for each, of in zip(own, main, strict=True))) if others else own


def as_main(found: Mapping[str, Judged]) -> Trained:
    """These in the place of the main experiment and its winners on fresh seeds."""
    chosen = {MAIN[task].name: judged.chosen for task, judged in found.items()}
    return Trained(chosen | {AGAIN[task].name: judged.again for task, judged in found.items()})


FIGURE = FigureStudy(
    "What makes the paper's result appear?",
    "The table judges the same claims again where one thing is changed: of how many tasks each clearly holds, and on "
    "how many the contrary. Tests are adjusted within a cell and not over the table, so a few cells are decided by "
    "chance. The figure is of hypothesis (b): final return on fresh seeds where the action box is times 1/8 to 8 and "
    "the environment divides by as much, with 95% bands over ten runs, on MuJoCo five. A softmax policy knows nothing "
    "of it; a Gaussian whose first σ is 1 does, unless its units are the box's. Above each panel stands of how many "
    "losses but the plain Gaussian all runs are the same to the bit at every scale. What is in the action's units is "
    "left out of that: σ, and a density's entropy and loss.",
    rescaling.draw,
    (
        *(sweep for key in changes.SWEEPS for sweep in (changes.SWEEPS[key], changes.AGAIN[key])),
        *rescaling.SWEEPS.values(),
        *changes.WITHOUT_LOWEST.values(),
    ),
    table=table,
)
