"""A sweep's results are the table of all runs, the best setting of each loss, and the study that checks it."""

import dataclasses
import json
from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
import pyarrow as pa
from jaxtyping import Float

from galton.errors import require
from galton.words import vocabulary
from galton_experiments.sweep.parquet import record_of, to_bytes, with_record
from galton_experiments.sweep.plan import Plan
from galton_experiments.sweep.shard import tables_of
from galton_experiments.sweep.store import Store
from galton_experiments.sweep.study import Setting, Study, filled

FILE = "results.parquet"


class Best(NamedTuple):
    """The best setting of a loss is that with the highest mean final training return over its trials (App. C.2)."""

    setting: Setting
    """As `best_settings` chooses it."""
    final_training_return: Float[np.ndarray, " trials"]
    """The final mean of each trial in training."""
    final_evaluation_return: Float[np.ndarray, " trials"]
    """The final mean of each trial by the deterministic policy."""
    n_settings: int
    """Of how many it is the best: the more, the more its mean flatters."""


def collect(store: Store, plan: Plan) -> pa.Table:
    """One row per run that is done, by setting and trial: its setting, its final numbers, its curves.

    Its record is the `provenance`. All else depends on the runs alone, not on when, where or in which order they were
    trained.

    Raises:
        UsageError: a shard's file was damaged.
    """
    tables = [*tables_of(store, plan)]
    require(bool(tables), f"out is {store.url}, where no shard is done yet")
    parts = [table.replace_schema_metadata(None) for table in tables]
    runs = pa.concat_tables(same_columns(parts)).sort_by([("setting", "ascending"), ("trial", "ascending")])
    records = filled([setting.record() for setting in plan.study.settings], vocabulary().usual)
    mixed = {name for record in records for name, value in record.items() if isinstance(value, str)}  # schedules, too
    settings = pa.Table.from_pylist([r | {name: str(r[name]) for name in mixed} for r in records])
    whole = pa.table(
        {f"setting.{name}": settings.column(name).take(runs.column("setting")) for name in settings.column_names}
        | {name: runs.column(name) for name in runs.column_names}
    )
    return with_record(whole.combine_chunks(), provenance(tables))


def provenance(shards: Sequence[pa.Table]) -> dict[str, Any]:
    """Say what made these shards: versions and machines, each once, and the seconds of all workers together."""
    records = [record_of(table) for table in shards]
    found = {json.dumps(record["versions"], sort_keys=True) for record in records}
    return {
        "versions": [json.loads(text) for text in sorted(found)],
        "machines": sorted({record["machine"] for record in records}),
        "train_seconds": round(sum(record["train_seconds"] for record in records)),
        "compile_seconds": round(sum(record["compile_seconds"] for record in records)),
    }


def of_study(table: pa.Table, planned: Study, study: Study) -> pa.Table:
    """The runs of a study out of those of a plan that covers it, whose settings may have another order."""
    places = {setting: i for i, setting in enumerate(planned.settings)}
    numbers = {places[setting]: i for i, setting in enumerate(study.settings)}
    theirs, trial = (table.column(name).to_numpy() for name in ("setting", "trial"))
    setting = np.array([numbers.get(i, -1) for i in theirs.tolist()], theirs.dtype)
    own = np.flatnonzero((setting >= 0) & (trial < study.trials))
    place = table.column_names.index("setting")
    renumbered = table.set_column(place, table.field(place), pa.array(setting))
    return renumbered.take(own[np.lexsort((trial[own], setting[own]))]).combine_chunks()


def same_columns(tables: Sequence[pa.Table]) -> list[pa.Table]:
    """The tables with the same columns each: curves that one of them lacks are NaN in it.

    Losses and algorithms tell different things of themselves, and later versions more than earlier ones.
    """
    schemas = {field.name: field for table in tables for field in table.schema}
    found = []
    for table in tables:
        for name, field in schemas.items():
            if name not in table.column_names:
                width, n = field.type.list_size, table.num_rows
                nothing = pa.array(np.full(n * width, np.nan, field.type.value_type.to_pandas_dtype()))
                table = table.append_column(field, pa.FixedSizeListArray.from_arrays(nothing, width))
        found.append(table.select(list(schemas)))
    return found


def save(store: Store, table: pa.Table) -> None:
    """Write the table, less its record, as results.parquet, unless that is there: a folder may be for reading alone."""
    data = to_bytes(table.replace_schema_metadata(None))
    if FILE not in store.names("") or store.read(FILE) != data:
        store.write(FILE, data)


def best_settings(study: Study, table: pa.Table) -> dict[str, Best]:
    """For each loss, among the settings whose trials are all there, the one with the fewest trials without a return.

    A diverged one has none. Of several settings it is that with the highest mean of the other final training returns.
    """
    columns = ("setting", "final_training_return", "final_evaluation_return")
    setting, training, evaluation = (table.column(name).to_numpy() for name in columns)
    places, lost = {setting: i for i, setting in enumerate(study.settings)}, np.isnan(training)
    count, diverged = (np.bincount(of, minlength=len(places)) for of in (setting, setting[lost]))
    total = np.bincount(setting[~lost], training[~lost], len(places))
    means = total / np.maximum(count - diverged, 1)
    found: dict[str, Best] = {}
    for loss in dict.fromkeys(s["loss"] for s in study.settings):
        own = [s for s, i in places.items() if s["loss"] == loss and count[i] == study.trials]
        if own:
            best = max(own, key=lambda s: (-diverged[places[s]], means[places[s]]))
            rows = setting == places[best]
            found[loss] = Best(best, training[rows], evaluation[rows], len(own))
    return found


def mean_returns(study: Study, table: pa.Table, metric: str = "training_return") -> dict[Setting, float]:
    """The mean final return of each setting whose trials are all there; −∞ where one diverged or has none."""
    setting, final = (table.column(name).to_numpy() for name in ("setting", f"final_{metric}"))
    n = len(study.settings)
    count = np.bincount(setting, minlength=n)
    total = np.bincount(setting, np.where(np.isnan(final), -np.inf, final), n)
    whole = np.flatnonzero(count == study.trials).tolist()
    return {study.settings[i]: float(total[i] / count[i]) for i in whole}


def rerun(study: Study, best: dict[str, Best], trials: int, seed: int) -> Study:
    """The winners alone, on fresh seeds: the mean of the best of many settings flatters, this one doesn't.

    Raises:
        UsageError: the seed is the study's own.
    """
    require(seed != study.seed, f"seed is {seed}, the sweep's own; another one gives fresh seeds")
    return dataclasses.replace(study, settings=tuple(b.setting for b in best.values()), trials=trials, seed=seed)
