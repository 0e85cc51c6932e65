"""The tables of a benchmark that documents quote, as Markdown.

A document says <!-- table: BENCHMARK: NAME --> where one stands, and
`python -m galton_experiments.benchmark.quoted benchmarks/BENCHMARK.toml results/BENCHMARK DOCUMENT ...` writes it.
NAME is `all tasks: METHOD; METHOD`, with the methods' names, `above: METHOD; METHOD` for P(above the baseline), or,
where the labels of all methods are "A, B", `crossed, TASK`: a row for each A, a column for each B.
"""

import sys
from collections.abc import Callable, Sequence
from pathlib import Path

from galton_experiments.benchmark.folder import load
from galton_experiments.benchmark.found import Found
from galton_experiments.benchmark.reading import read
from galton_experiments.benchmark.tables import returns_of
from galton_experiments.page import quotes
from galton_experiments.sweep.store import Store


def tables(file: Path, folder: str) -> Callable[[str], str | None]:
    """Return a lookup of tables by file and name: None of another file, or where its stages are not done."""
    found, name = load(Store(folder), read(file)), file.stem
    known: dict[str, str] = {}
    if all(", " in method.label for method in found.protocol.methods) and "fresh" in found.standings:
        known = {f"{name}: crossed, {task}": _crossed(found, task) for task in found.standings["fresh"].tasks}
    of_some: dict[str, Callable[[Sequence[str]], str]] = {}
    if found.standings:
        of_some[f"{name}: all tasks"] = lambda names: _of_methods(found, names)
    if {"fresh", "held-out"} <= found.standings.keys():
        of_some[f"{name}: above"] = lambda names: _above(found, names)

    def table(wanted: str) -> str | None:
        kind, _, names = wanted.rpartition(": ")
        return of_some[kind](names.split("; ")) if kind in of_some else known.get(wanted)

    return table


def _above(found: Found, names: Sequence[str]) -> str:
    """P(above the baseline) of some methods: with one setting at each stage, and with a setting for each task."""
    named, base = {method.name: method for method in found.protocol.methods}, found.protocol.baseline
    fresh, held_out = found.standings["fresh"], found.standings["held-out"]
    rows = [
        [
            named[name].label,
            f"{fresh.above[name][base.name]:.2f}",
            f"{held_out.above[name][base.name]:.2f}",
            f"{fresh.above_per_task[name]:.2f}",
        ]
        for name in names
    ]
    against = f"P(above {base.label})"
    return quotes.markdown([against, "tuning tasks", "held-out tasks", "tuned for each task"], rows)


def _of_methods(found: Found, names: Sequence[str]) -> str:
    """Returns of some methods' shared settings, a row for each task of all stages."""
    named = {method.name: method for method in found.protocol.methods}
    labels = {task.name: f"{task.label} (held out)" if task.held_out else task.label for task in found.protocol.tasks}
    rows = [
        [labels[task], *(returns_of(standings, task, named[name], "shared") for name in names)]
        for standings in found.standings.values()
        for task in standings.tasks
    ]
    return quotes.markdown(["task", *(named[name].label for name in names)], rows)


def _crossed(found: Found, task: str) -> str:
    """Returns on a task where the methods are one thing crossed with another, as their labels say."""
    standings = found.standings["fresh"]
    cells = {method.label: returns_of(standings, task, method, "shared") for method in found.protocol.methods}
    rows, columns = map(dict.fromkeys, zip(*(label.rsplit(", ", 1) for label in cells), strict=True))
    lines = [[row, *(cells.get(f"{row}, {column}", "—") for column in columns)] for row in rows]
    return quotes.markdown(["", *columns], lines)


if __name__ == "__main__":
    quotes.write(tables(Path(sys.argv[1]), sys.argv[2]), sys.argv[3:])
