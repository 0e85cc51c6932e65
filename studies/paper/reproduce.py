"""The sweeps of figures are trained, each in a folder of its own, then kept as a summary of a megabyte or less."""

from collections.abc import Callable, Iterable, Mapping
from typing import Any, get_args

import pyarrow as pa

from galton.errors import UsageError, require
from galton.saving import machine, versions
from galton_experiments.runs import Summary
from galton_experiments.sweep import CarryOut, Store, columns, train_stage
from galton_experiments.sweep.parquet import opened, record_of, to_bytes, with_record
from studies.paper.figure import FigureStudy
from studies.paper.registry import FIGURES, all_sweeps
from studies.paper.sweeps import Budget, Sweep, needed, unpaired
from studies.paper.trained import Trained

BUDGETS = get_args(Budget)
MEASURED: dict[str, Any] = {"budget": "", "versions": [{}], "machines": [""]}
"""The fields in which a file says how its numbers were made, each with a value of its type."""
SUMMARISED = MEASURED | {"train_seconds": 0.0, "compile_seconds": 0.0}
COMMAND = "python -m studies.paper"
AGAIN = f"{COMMAND} reproduce"
"""The command that made a folder, for messages."""
DATA = "data"
"""The folder, inside that of a reproduction, of summaries and of what figures measured."""


def load(out: str) -> Trained:
    """The summaries and tables that a folder of `python -m studies.paper reproduce` holds.

    Raises:
        UsageError: a file there is damaged, or something else.
    """
    store = Store(out).below(DATA)
    files = store.names("")
    sweeps = {name: Summary.load(store, f"{name}.parquet") for name in all_sweeps() if f"{name}.parquet" in files}
    for name, summary in sweeps.items():
        _check_provenance(f"{name}.parquet in {store.url}", summary.provenance, SUMMARISED)
    measured = {name: fig for name, fig in FIGURES.items() if fig.measure and f"{name}.parquet" in files}
    return Trained(sweeps, {name: _measured(store, f"{name}.parquet", fig) for name, fig in measured.items()})


def _measured(store: Store, file: str, figure: FigureStudy) -> pa.Table:
    def read(table: pa.Table, _: Mapping[str, Any]) -> pa.Table:
        figure.check(table)
        return table

    where, told = f"{file} in {store.url}", "not what was measured, or was damaged"
    table = opened(store.read(file), where, read, told, f"remove it, and make it again with: {AGAIN}")
    _check_provenance(where, record_of(table), MEASURED)
    return table


def _check_provenance(where: str, record: Mapping[str, Any], example: dict[str, Any]) -> None:
    """Raise UsageError unless a file says how it was made, as `train` and `measure` do."""
    try:
        columns.check_record(dict(record), example)
        require(record["budget"] in BUDGETS, f"its budget is {record['budget']!r}; it must be {' or '.join(BUDGETS)}")
    except UsageError as error:
        told = f"{where} can't be used: {error}; remove it, and make it again with: {AGAIN}"
        raise UsageError(told) from None


def of_no_figure(out: str) -> list[str]:
    """The files of a folder's data that no figure knows, such as those of a study that was not imported."""
    known = {f"{name}.parquet" for name in (*all_sweeps(), *FIGURES)}
    return [file for file in Store(out).below(DATA).names("") if file.endswith(".parquet") and file not in known]


def refuse_other_budgets(sweeps: Iterable[Sweep], measured: Iterable[str], budget: Budget, out: str) -> None:
    """Raise before anything is trained for a folder that has some of it at another budget.

    Raises:
        UsageError: it has some, with what to do about it.
    """
    there = load(out)
    made = {sweep.name: done.provenance["budget"] for sweep in needed(sweeps) if (done := there.of(sweep))}
    made |= {name: record_of(there.tables[name])["budget"] for name in measured if name in there.tables}
    for name, other in made.items():
        if other != budget:
            raise UsageError(
                f"out is {out}, whose {name} was made with budget {other!r}, not {budget!r}; name another folder, or "
                f"remove {DATA}/{name}.parquet there"
            )


def measure(
    figures: Mapping[str, FigureStudy], budget: Budget, out: str, tell: Callable[[str], None] = lambda _: None
) -> None:
    """Measure what these figures need besides sweeps, unless the folder has it, and write it there.

    Before each, `tell` is told which of how many it is, and its name.
    """
    there = load(out).tables
    wanted = {name: figure.measure for name, figure in figures.items() if figure.measure is not None}
    for i, (name, measured) in enumerate(wanted.items(), 1):
        if name not in there:
            tell(f"measurement {i} of {len(wanted)}: {name}")
            record = {"budget": budget, "versions": [versions()], "machines": [machine()]}
            Store(out).below(DATA).write(f"{name}.parquet", to_bytes(with_record(measured(budget), record)))


def train(
    sweeps: Iterable[Sweep], budget: Budget, out: str, workers: CarryOut, tell: Callable[[str], None] = lambda _: None
) -> None:
    """Train the sweeps that are not done yet, after those whose winners they train, and write a summary of each.

    Summaries go to the folder `data` of `out`, the runs to `sweeps`. Before each, `tell` is told which of how many it
    is, and its name.

    Raises:
        UsageError: the folder holds a sweep that is not the one asked for, or is in use, or full.
    """
    store, done = Store(out), dict(load(out).sweeps)
    wanted = list(needed(sweeps))
    for i, sweep in enumerate(wanted, 1):
        name, study = sweep.name, sweep.study(budget, done)
        if name in done:
            there = done[name].study
            if there not in (study, unpaired(study, there.trials) if study.common_seeds else study):
                raise UsageError(
                    f"out is {out}, whose {name} is of another study than this version and budget {budget!r} ask for; "
                    f"name another folder, or remove {DATA}/{name}.parquet there"
                )
            continue
        tell(f"{i} of {len(wanted)}: {name}")
        (runs,) = train_stage(store, name, [study], workers, 2 if budget == "smoke" else None)  # few programs
        table = runs.table()
        done[name] = Summary.of_results(study, table, {"budget": budget} | record_of(table))
        done[name].save(store.below(DATA), f"{name}.parquet")
