"""galton reproduce: the paper's figures, from the first run to the page."""

import dataclasses
from collections.abc import Sequence
from pathlib import Path
from typing import Annotated

import tyro

from galton.commands.carry import processes
from galton.commands.report import write
from galton.errors import UsageError
from galton.studies import reproduce
from galton.studies.registry import FIGURES, find_figure
from galton.studies.sweeps import Budget
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
    """Figures, tasks, the four analytic tasks, the three MuJoCo ones, or all of it."""
    budget: Budget = "smoke"
    """How much: minutes that show only that it works; less than an hour or two; or the paper's settings and trials."""
    out: Path = Path("runs/paper")
    """The folder for runs, summaries, figures and page."""
    workers: int | None = None
    """Processes, by default one per core."""


def main(arguments: Sequence[str]) -> None:
    """Train, then report."""
    options = tyro.cli(Options, prog="galton reproduce", args=list(arguments), config=(tyro.conf.OmitArgPrefixes,))
    sweeps, propositions = asked(options.what)
    places = one_per_core(options.workers)
    if options.budget == "smoke":  # compiling is all that takes time
        places = [Place(place.cores, (("JAX_DISABLE_MOST_OPTIMIZATIONS", "1"),)) for place in places]
    reproduce.refuse_other_budgets(sweeps, propositions, options.budget, str(options.out))
    with processes(places) as carry_out:
        reproduce.train(sweeps, options.budget, str(options.out), carry_out)
    if propositions:
        reproduce.measure_propositions(options.budget, str(options.out))
    write(options.out, reproduce.load(str(options.out)))


def asked(what: Sequence[str]) -> tuple[list[str], bool]:
    """The sweeps that these words ask for, and whether the propositions are asked for too.

    Raises:
        UsageError: a word that means nothing here.
    """
    figures, tasks = list(FIGURES), list(TASKS)
    if "all" not in what:
        for word in what:
            if word not in (*FIGURES, *TASKS, *GROUPS):
                raise UsageError(f"what is {word!r}; choose from {', '.join([*FIGURES, *TASKS, *GROUPS, 'all'])}")
        figures = [word for word in what if word in FIGURES]
        tasks = [task for word in what for task in GROUPS.get(word, (word,)) if task in TASKS]
    sweeps = [sweep for figure in figures for sweep in find_figure(figure).sweeps]
    sweeps += [sweep for task in tasks for sweep in (task, f"{task}-again")]
    return list(dict.fromkeys(sweeps)), "propositions" in figures
