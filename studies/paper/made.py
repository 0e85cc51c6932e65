"""How what is on the page was made: a row for each sweep and for each table of measurements."""

from collections.abc import Mapping, Sequence
from typing import Any

from galton_experiments.page import Section, Table
from galton_experiments.runs import Summary
from galton_experiments.sweep.parquet import record_of
from studies.paper.prose import text
from studies.paper.registry import FIGURES, all_sweeps
from studies.paper.sweeps import AGAIN, MAIN, Sweep
from studies.paper.trained import Trained

NAME = "how-made"
_HEADINGS = (
    "sweep",
    "settings",
    "trials",
    "steps",
    "seed",
    "episodes per steps",
    "budget",
    "core minutes",
    "on",
    "with",
    "word",
)


def section(trained: Trained) -> Section:
    """All that was trained and measured, as the last section of the page."""
    records = {name: summary.provenance for name, summary in trained.sweeps.items()}
    records |= {name: record_of(table) for name, table in trained.tables.items()}
    sweeps = all_sweeps()
    names = [name for name in (*sweeps, *FIGURES) if name in records]
    machines, versions = (_keyed([value for name in names for value in records[name][of]]) for of in _KEYED)
    rows = []
    for name in names:
        made = records[name]
        of_study = _study(trained.sweeps[name]) if name in trained.sweeps else ["—"] * 5
        minutes = f"{_minutes(made):,.0f}" if "train_seconds" in made else "—"
        keys = [_keys_of(made[of], keyed) for of, keyed in zip(_KEYED, (machines, versions), strict=True)]
        called = f"{name} ({sweeps[name].title})" if name in sweeps and sweeps[name].title else name
        rows.append([called, *of_study, made["budget"], minutes, *keys, _word(name)])
    words = text("page")["budgets"]
    budgets = dict.fromkeys(records[name]["budget"] for name in names)
    paragraphs = [
        "A row is trained again by: python -m studies.paper reproduce WORD --budget BUDGET --out DIR. Sweeps of seed 0 "
        "choose settings, those of seed 1 judge them; in pairs means that trial t has the same seed in all settings. "
        "Each evaluation plays so many episodes by the deterministic policy, once in so many steps; twice means by the "
        "most likely and by the mean action.",
        " ".join(f"Budget {budget}: {words[budget]}." for budget in budgets),
        f"Machines: {_told(machines)}.",
        f"Versions: {_told(versions)}.",
    ]
    return Section(NAME, "How all of this was made", table=Table(_HEADINGS, rows), paragraphs=paragraphs)


_KEYED = ("machines", "versions")
Value = str | tuple[tuple[str, str], ...]
"""A machine, or the versions of packages."""


def _keyed(values: Sequence[object]) -> dict[Value, str]:
    """A letter for each of the values, in order."""
    found = dict.fromkeys(map(_value, values))
    return {value: chr(ord("A") + i) if i < 26 else str(i) for i, value in enumerate(found)}


def _keys_of(values: Sequence[object], keyed: Mapping[Value, str]) -> str:
    return ", ".join(dict.fromkeys(keyed[_value(value)] for value in values))


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


def _minutes(made: Mapping[str, Any]) -> float:
    return float(made["train_seconds"] + made["compile_seconds"]) / 60


def _word(name: str) -> str:
    """What `reproduce` calls it: a task, or the figure that needs it."""
    for task in MAIN:
        if name in (MAIN[task].name, AGAIN[task].name):
            return task
    needs: dict[str, tuple[Sweep, ...]] = {figure: study.sweeps for figure, study in FIGURES.items()}
    return next((figure for figure, sweeps in needs.items() if any(sweep.name == name for sweep in sweeps)), name)
