"""One shard: trained, and committed as one Parquet file whose name holds its checksum."""

import dataclasses
import datetime
import functools
import re
from collections.abc import Iterator
from typing import Any

import jax
import numpy as np
import pyarrow as pa

from galton.devices import use_all_cores
from galton.envs.find import find
from galton.envs.registry import read_constants
from galton.errors import UsageError, require
from galton.extras import import_all
from galton.saving.provenance import machine
from galton.training.log import Log
from galton.training.train import Result, log_points, train
from galton_experiments.sweep import columns
from galton_experiments.sweep.begun import FOLDER, Begun, versions_of
from galton_experiments.sweep.parquet import opened, record_of, to_bytes, with_record
from galton_experiments.sweep.plan import Plan, Shard
from galton_experiments.sweep.store import Store, checksum

NEEDED = (
    *("setting", "trial", "seed", "diverged_at", "steps", "final_training_return", "final_evaluation_return"),
    *(name for name in Log._fields if name != "scalars"),
)
"""The columns that every shard has, beside those that its algorithm tells of."""
RECORD = {
    "shard": "",
    "env_steps": 0.0,
    "compile_seconds": 0.0,
    "train_seconds": 0.0,
    "finished": "",
    "versions": {},
    "machine": "",
}
"""The fields of every shard's metadata, each with a value of its type."""
_prepare = functools.cache(use_all_cores)
"""Prepares a process for its shards, once."""
_NAME = re.compile(r"(\d{7,})-([0-9a-f]{16})-([0-9a-f]{32})\.parquet")


@dataclasses.dataclass(frozen=True)
class Done:
    """This much is known of a finished shard without opening its file."""

    index: int
    name: str
    """The shard's name: a hash of all that determined its results."""
    checksum: str
    file: str
    plan: Plan = dataclasses.field(repr=False, compare=False)
    """The plan whose runs it must hold."""


@dataclasses.dataclass(frozen=True)
class Report:
    """A worker reports on the shard that it finished; arrays are plain numbers, small enough to send."""

    index: int
    setting: list[int]
    final_training_return: list[float]
    """The final return of each run; NaN for one that diverged."""
    steps: int
    """The environment steps that were trained, all runs together."""
    train_seconds: float


def work(url: str, index: int, name: str | None = None) -> Report:
    """Train shard `index` of the plan at `url` and commit it. Doing it again replaces nothing and does no harm.

    One that an earlier worker began, with the same versions and modules, goes on from what was kept of it.

    Args:
        url: the sweep's folder, as this process sees it.
        index: of the shard.
        name: of the shard, if the plan might be another by now.

    Raises:
        UsageError: no such plan, or one whose shard is of another name; no room to write.
        BrokenEnvironmentError: the environment broke.
    """
    _prepare()
    store = Store(url)
    import_all(Plan.imports(store))
    plan = Plan.load(store)
    shard = plan.get(index)
    require(
        name in (None, shard.name),
        f"out is {url}, whose plan was replaced meanwhile; give each sweep a folder of its own",
    )
    study = plan.study
    env = find(study.env, **read_constants(study.env_kwargs))  # imports its module, which is among the versions
    begun = Begun(store, f"{index:07d}-{shard.name}", study.modules)
    result = train(
        env,
        shard.agent,
        shard.seeds.tolist(),
        study.steps,
        n_logs=study.logs,
        n_eval_episodes=study.eval_episodes,
        eval_mean=study.eval_mean,
        keep=begun.keep,
        kept=begun.kept(),
        devices=jax.devices()[:1],  # a split would change the last bits
    )
    table = tabulate(shard, result, versions_of(tuple(study.modules)))
    data = to_bytes(table)
    store.write(f"{FOLDER}/{index:07d}-{shard.name}-{checksum(data)}.parquet", data)
    begun.forget()
    return report(index, table)


def tabulate(shard: Shard, result: Result, made_by: dict[str, str | None]) -> pa.Table:
    """A table of one row per run: what it is, its final numbers and its curves. Machine and times are its metadata."""
    n = len(shard.seeds)
    content: dict[str, object] = {
        "setting": shard.setting,
        "trial": shard.trial,
        "seed": shard.seeds,
        "final_training_return": result.final("training_return").astype(np.float32),
        "final_evaluation_return": result.final("evaluation_return").astype(np.float32),
        "diverged_at": result.diverged_at.astype(np.int32),
        "steps": _lists(np.broadcast_to(result.steps.astype(np.int32), (n, len(result.steps)))),
    }
    for name, curves in result.log.columns().items():
        content[name] = _lists(np.asarray(curves, np.float32))
    record = {
        "shard": shard.name,
        "env_steps": n * int(result.steps[-1]),
        "compile_seconds": result.compile_seconds,
        "train_seconds": result.train_seconds,
        "finished": datetime.datetime.now(datetime.UTC).isoformat(timespec="seconds"),
        "versions": made_by,
        "machine": machine(),
    }
    return with_record(pa.table(content), record)


def report(index: int, table: pa.Table) -> Report:
    """The report of a shard, from its table."""
    record = record_of(table)
    setting, final = (table.column(name).to_pylist() for name in ("setting", "final_training_return"))
    return Report(index, setting, final, record["env_steps"], record["train_seconds"])


def finished(store: Store, plan: Plan) -> dict[int, Done]:
    """The shards of this plan that are there, by their names alone; a file of other runs does not count."""
    found: dict[int, Done] = {}
    for file in store.names(FOLDER):
        match = _NAME.fullmatch(file)
        if match and int(match[1]) < plan.n_shards and plan.names[int(match[1])] == match[2]:
            found[int(match[1])] = Done(int(match[1]), match[2], match[3], file, plan)
    return found


def read(store: Store, done: Done) -> pa.Table | None:
    """The table of a finished shard; None where the file was damaged or is gone.

    Raises:
        UsageError: it can't be read now, which says nothing of what is in it; or it is whole, but does not hold the
            shard's runs as `work` writes them.
    """
    try:
        data = store.read(f"{FOLDER}/{done.file}")
    except FileNotFoundError:
        return None
    if checksum(data) != done.checksum:
        return None
    where, remedy = f"{FOLDER}/{done.file} in {store.url}", "run the sweep again, which trains its runs anew"
    told = "not what this sweep's workers write"
    return opened(data, where, functools.partial(check, done), told, f"remove the file and {remedy}")


def tables_of(store: Store, plan: Plan) -> Iterator[pa.Table]:
    """The tables of all finished shards; UsageError where a file was damaged."""
    for done in finished(store, plan).values():
        table = read(store, done)
        if table is None:
            raise UsageError(f"{done.file} in {store.url} was damaged; run the sweep again to replace it")
        yield table


def check(done: Done, table: pa.Table, record: dict[str, Any]) -> pa.Table:
    """The table, if it holds what `tabulate` makes of the runs of a shard; UsageError otherwise."""
    plan, runs = done.plan, slice(*done.plan.bounds[done.index : done.index + 2].tolist())
    columns.check_names(table, NEEDED)
    for name, wanted in (("setting", plan.setting), ("trial", plan.trial), ("seed", plan.seed)):
        same = np.array_equal(columns.numbers(table, name, wanted.dtype.type), wanted[runs])
        require(same, f"its {name} are not those of shard {done.index}")
    steps = log_points(plan.firsts[done.index].rollout_size, plan.study.steps, plan.study.logs)
    given = columns.curves(table, "steps", np.int32, len(steps))
    require((given == steps).all(), f"its steps are not the {len(steps)} log points of this sweep")
    diverged_at = columns.numbers(table, "diverged_at", np.int32)
    require(((diverged_at >= -1) & (diverged_at <= steps[-1])).all(), "its diverged_at are no steps of this sweep")
    for name in set(table.column_names) - {"setting", "trial", "seed", "diverged_at", "steps"}:
        if name.startswith("final_"):
            columns.numbers(table, name, np.float32)
        else:
            columns.curves(table, name, np.float32, len(steps))
    columns.check_record(record, RECORD)
    require(record["shard"] == done.name, f"its record is of shard {record['shard']}, not {done.name}")
    return table


def discard(store: Store, done: Done) -> None:
    """Remove a damaged file, so that its shard is trained again."""
    store.remove(f"{FOLDER}/{done.file}")


def _lists(rows: np.ndarray) -> pa.Array:
    return pa.FixedSizeListArray.from_arrays(pa.array(np.ascontiguousarray(rows).ravel()), rows.shape[1])
