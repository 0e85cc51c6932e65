"""The command of the paper's study, in a clone: python -m studies.paper reproduce | report | tables."""

import fnmatch
import functools
import importlib
import sys
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import tyro

from galton.errors import BrokenEnvironmentError, UsageError, did_you_mean, require
from galton.tasks import TASKS
from galton_experiments.page import quotes
from galton_experiments.sweep import Place, one_per_core
from galton_experiments.sweep import workers as processes
from studies.paper import report as page
from studies.paper import reproduce as paper
from studies.paper.figure import FigureStudy
from studies.paper.registry import FIGURES, all_sweeps
from studies.paper.sweeps import AGAIN, MAIN, Budget, Sweep

GROUPS = {
    "analytic": tuple(task for task in TASKS if TASKS[task].in_jax),
    "mujoco": tuple(task for task in TASKS if not TASKS[task].in_jax),
}


def reproduce(
    what: tyro.conf.Positional[tuple[str, ...]],
    budget: Budget = "smoke",
    out: Path = Path("runs/paper"),
    workers: int | None = None,
    imports: tuple[str, ...] = (),
) -> None:
    """Train what figures of the paper need, draw them, and write the page that says what holds.

    Run it again to go on where it stopped; what has a summary in OUT/data is not trained again.

    Args:
        what: figures, tasks, `analytic`, `mujoco`, or `all`; or sweeps, by the names of their files in OUT/data, in
            which * stands for any letters ('*reacher*').
        budget: how much. smoke: minutes that show only that it works; small: less than an hour or two; grid: the
            paper's settings with few trials; paper: its settings and trials.
        out: the folder for runs, summaries, figures and page.
        workers: processes, by default one per core.
        imports: modules to import first, where figures of your own are registered.

    Raises:
        UsageError: a word that means nothing here, or a folder that holds something else.
    """
    _import(imports)
    sweeps, figures = asked(what)
    places = one_per_core(workers)
    if budget == "smoke":  # compiling is all that takes time
        places = [Place(place.cores, (("JAX_DISABLE_MOST_OPTIMIZATIONS", "1"),)) for place in places]
    paper.refuse_other_budgets(sweeps, figures, budget, str(out))
    tell = functools.partial(print, flush=True)
    with processes(places) as carry_out:
        paper.train(sweeps, budget, str(out), carry_out, tell)
    paper.measure(figures, budget, str(out), tell)
    page.write(out, paper.load(str(out)))


def report(folder: tyro.conf.Positional[Path], imports: tuple[str, ...] = ()) -> None:
    """Draw the figures and write the page, from the summaries that `reproduce` left in a folder.

    Args:
        folder: its data are read; figures/, index.html and tables.md are written.
        imports: modules to import first, where figures of your own are registered.

    Raises:
        UsageError: a folder without data.
    """
    _import(imports)
    trained = paper.load(str(folder))
    for file in paper.of_no_figure(str(folder)):
        told = "is of no figure and left out; name the module that registers its study with --imports"
        print(f"{paper.DATA}/{file} {told}", file=sys.stderr)
    there = bool(trained.sweeps or trained.tables)
    require(there, f"folder is {str(folder)!r}, which holds no data; make some with: {paper.COMMAND} reproduce")
    page.write(folder, trained)


def tables(folder: tyro.conf.Positional[Path], documents: tyro.conf.Positional[tuple[str, ...]]) -> None:
    """Write the tables of a folder of `reproduce` into the documents that name them.

    Args:
        folder: what `reproduce` made.
        documents: Markdown files.
    """
    quotes.write(page.tables(paper.load(str(folder))).get, documents)


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


def _import(modules: Sequence[str]) -> None:
    for name in modules:
        try:
            importlib.import_module(name)
        except ImportError as error:
            raise UsageError(f"imports names {name!r}, which can't be imported: {error}") from None


def main() -> None:
    """Do what the command line says; a wrong word is one line, and exit code 2."""
    commands: dict[str, Callable[..., Any]] = {"reproduce": reproduce, "report": report, "tables": tables}
    try:
        tyro.extras.subcommand_cli_from_dict(commands, prog=paper.COMMAND)
    except (UsageError, BrokenEnvironmentError, OSError) as error:
        print(f"{paper.COMMAND}: {error}", file=sys.stderr)
        sys.exit(2)
    except KeyboardInterrupt as interrupt:
        done = f"{interrupt}, and " if interrupt.args else ""
        print(f"{paper.COMMAND}: interrupted; {done}the same command goes on with the rest", file=sys.stderr)
        sys.exit(130)


if __name__ == "__main__":
    main()
