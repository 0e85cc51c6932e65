"""galton reproduce: the paper's figures, from the first run to the page."""

import dataclasses
import fnmatch
import functools
from collections.abc import Sequence
from pathlib import Path
from typing import Annotated

import tyro

from galton.cli._carry import processes
from galton.cli._modules import import_typed
from galton.cli._reading import read_options
from galton.cli.report import write
from galton.errors import UsageError, did_you_mean, require
from galton.paper import reproduce as paper
from galton.paper.figure import FigureStudy
from galton.paper.registry import FIGURES, all_sweeps
from galton.paper.sweeps import AGAIN, MAIN, Budget, Sweep
from galton.sweep.executors import Place, one_per_core
from galton.tasks import TASKS

GROUPS = {
    "analytic": tuple(task for task in TASKS if TASKS[task].in_jax),
    "mujoco": tuple(task for task in TASKS if not TASKS[task].in_jax),
}


@dataclasses.dataclass(frozen=True)
class Options:
    """Train what figures of the paper need, draw them, and write the page that says what holds.

    Run it again to go on where it stopped; what has a summary in OUT/data is not trained again.
    """

    what: tyro.conf.Positional[
        Annotated[tuple[str, ...], tyro.conf.arg(metavar="{" + ",".join([*FIGURES, *TASKS, *GROUPS, "all"]) + "} ...")]
    ]
    """Figures, tasks, the four analytic tasks, the three MuJoCo ones, or all of it; or sweeps, by the names of their
    files in OUT/data, in which * stands for any letters ('*reacher*')."""
    budget: Budget = "smoke"
    """How much. smoke: minutes that show only that it works; small: less than an hour or two; grid: the paper's
    settings with few trials; paper: its settings and trials."""
    out: Path = Path("runs/paper")
    """The folder for runs, summaries, figures and page."""
    workers: int | None = None
    """Processes, by default one per core."""
    imports: tuple[str, ...] = ()
    """Modules to import first, where figures of your own are registered."""


def main(arguments: Sequence[str]) -> None:
    """Train and measure what the words ask for, then draw the figures and write the page."""
    options = read_options(Options, "reproduce", arguments)
    import_typed(options.imports)
    reproduce(options.what, options.budget, options.out, options.workers)


def reproduce(what: Sequence[str], budget: Budget, out: Path, workers: int | None = None) -> None:
    """Train what these words ask for, measure, draw and write the page; what is done already is left as it is.

    Raises:
        UsageError: a word that means nothing here, or a folder that holds something else.
    """
    sweeps, figures = asked(what)
    places = one_per_core(workers)
    if budget == "smoke":  # compiling is all that takes time
        places = [Place(place.cores, (("JAX_DISABLE_MOST_OPTIMIZATIONS", "1"),)) for place in places]
    paper.refuse_other_budgets(sweeps, figures, budget, str(out))
    tell = functools.partial(print, flush=True)
    with processes(places) as carry_out:
        paper.train(sweeps, budget, str(out), carry_out, tell)
    paper.measure(figures, budget, str(out), tell)
    write(out, paper.load(str(out)))


def asked(what: Sequence[str]) -> tuple[list[Sweep], dict[str, FigureStudy]]:
    """The sweeps that these words ask for, and the figures among the words.

    Raises:
        UsageError: a word that means nothing here.
    """
    figures, tasks = dict(FIGURES), list(TASKS)
    known = [*FIGURES, *TASKS, *GROUPS, "all"]
    require(len(what) > 0, f"what to reproduce is not said; choose from {', '.join(known)}")
    named = {word: fnmatch.filter(all_sweeps(), word) for word in what if word not in known}
    for word, found in named.items():
        if not found:
            choices = [*known, "the name of a sweep, such as reacher-again or '*reacher*'"]
            meant = did_you_mean(word, known)
            raise UsageError(f"{word!r} is nothing to reproduce; choose from {', '.join(choices)}{meant}")
    if "all" not in what:
        figures = {word: FIGURES[word] for word in what if word in FIGURES}
        tasks = [task for word in what for task in GROUPS.get(word, (word,)) if task in TASKS]
    sweeps = [sweep for figure in figures.values() for sweep in figure.sweeps]
    sweeps += [sweep for task in tasks for sweep in (MAIN[task], AGAIN[task])]
    sweeps += [all_sweeps()[name] for found in named.values() for name in found]
    return list(dict.fromkeys(sweeps)), figures
