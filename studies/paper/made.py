"""A table tells how what is on the page was made: a row for each sweep and for each table of measurements."""

from collections.abc import Mapping, Sequence

from galton_experiments.page import Section, Table
from galton_experiments.runs import Summary
from galton_experiments.sweep.parquet import record_of
from studies.paper.prose import text
from studies.paper.registry import FIGURES, all_sweeps
from studies.paper.sweeps import AGAIN, MAIN, Sweep
from studies.paper.trained import Trained

NAME = "how-made"


def section(trained: Trained) -> Section:
    """All that was trained and measured, as the last section of the page."""
    records = {name: summary.provenance for name, summary in trained.sweeps.items()}
    records |= {name: record_of(table) for name, table in trained.tables.items()}
    sweeps = all_sweeps()
    names = [name for name in (*sweeps, *FIGURES) if name in records]
    machines, versions = (_keyed([value for name in names for value in records[name][of]]) for of in _KEYED)
    known, rows = [("machines", machines), ("versions", versions)], []
    for name in names:
        made = records[name]
        of_study = _study(trained.sweeps[name]) if name in trained.sweeps else ["—"] * 5
        is_sweep = "train_seconds" in made
        minutes = f"{(made['train_seconds'] + made['compile_seconds']) / 60:,.0f}" if is_sweep else "—"
        keys = [", ".join(dict.fromkeys(keyed[_value(value)] for value in made[of])) for of, keyed in known]
        called = f"{name} ({sweeps[name].title})" if name in sweeps and sweeps[name].title else name
        rows.append([called, *of_study, made["budget"], minutes, *keys, _word(name)])
    words, told = text("page"), text("page")["how-made"]
    budgets = dict.fromkeys(records[name]["budget"] for name in names)
    paragraphs = [
        told["text"],
        " ".join(f"Budget {budget}: {words['budgets'][budget]}." for budget in budgets),
        f"Machines: {_told(machines)}.",
        f"Versions: {_told(versions)}.",
    ]
    return Section(NAME, told["title"], table=Table(told["headings"], rows), paragraphs=paragraphs)


_KEYED = ("machines", "versions")
Value = str | tuple[tuple[str, str], ...]
"""A machine, or the versions of packages."""


def _keyed(values: Sequence[object]) -> dict[Value, str]:
    """A letter for each of the values, in order."""
    found = dict.fromkeys(map(_value, values))
    return {value: chr(ord("A") + i) if i < 26 else str(i) for i, value in enumerate(found)}


def _value(value: object) -> Value:
    return tuple((name, str(of)) for name, of in value.items() if of) if isinstance(value, dict) else str(value)


def _told(keyed: Mapping[Value, str]) -> str:
    """Each value after its letter; of versions what all share once, in the end."""
    pairs = [{*value} for value in keyed if not isinstance(value, str)]
    shared = set.intersection(*pairs) if len(pairs) > 1 else set()
    told = []
    for value, key in keyed.items():
        own = value if isinstance(value, str) else ", ".join(" ".join(pair) for pair in value if pair not in shared)
        told.append(f"{key} {own}")
    common = ", ".join(" ".join(pair) for value in [*keyed][:1] for pair in value if pair in shared)
    return "; ".join(told) + (f"; all with {common}" if common else "")


def _study(summary: Summary) -> list[str]:
    """Its size, seeds and evaluation, as the table's cells."""
    study = summary.study
    per = f"{study.eval_episodes} per {study.steps // study.logs:,}" if study.eval_episodes else "none"
    seeds = f"{study.seed}, in pairs" if study.common_seeds else f"{study.seed}"
    evaluated = per + (", twice" if study.eval_mean else "")
    return [f"{len(study.settings):,}", f"{study.trials}", f"{study.steps:,}", seeds, evaluated]


def _word(name: str) -> str:
    """Return the word that `reproduce` has for it: a task, or the figure that needs it."""
    for task in MAIN:
        if name in (MAIN[task].name, AGAIN[task].name):
            return task
    needs: dict[str, tuple[Sweep, ...]] = {figure: study.sweeps for figure, study in FIGURES.items()}
    return next((figure for figure, sweeps in needs.items() if any(sweep.name == name for sweep in sweeps)), name)
