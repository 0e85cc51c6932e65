"""The folder of a benchmark: the file it was begun with, the sweeps of each part, and what comes of them."""

import dataclasses
import functools
import json
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from galton.errors import UsageError, require
from galton_experiments.analysis.plain import plain, rounded
from galton_experiments.benchmark.draws import Draws, draws
from galton_experiments.benchmark.found import Found
from galton_experiments.benchmark.protocol import Protocol
from galton_experiments.benchmark.runs import Runs, gather
from galton_experiments.benchmark.stages import Part, Stage, afterwards, tuning, width
from galton_experiments.sweep.engine import CarryOut, Trained, train_stage
from galton_experiments.sweep.parquet import record_of
from galton_experiments.sweep.shard import tables_of
from galton_experiments.sweep.store import Store
from galton_experiments.sweep.study import Setting, canonical

FILE = "benchmark.json"
"""The file of what the folder was begun with: the content of the benchmark's file, its hash, and the draws."""
DATA = "data"
"""The folder of the parts that are done."""
MADE = "provenance.json"
"""The file that tells how the parts were made, and how long that took: what differs from one time to the next."""


def begin(store: Store, protocol: Protocol) -> Draws:
    """Write what the folder is begun with, or check that it was begun with the same; the draws.

    Raises:
        UsageError: it was begun with something else; the message says what differs.
    """
    drawn = draws(protocol)
    record = plain({"benchmark": protocol.digest, "file": protocol.record, "draws": drawn})
    try:
        there = json.loads(store.read(FILE))
        file, known, digest = there["file"], there["draws"], there["benchmark"]
    except FileNotFoundError:
        store.write(FILE, written(record))
        return drawn
    except (ValueError, KeyError, TypeError, RecursionError) as error:
        raise UsageError(f"out is {store.url}, whose {FILE} was damaged ({error}); name another folder") from None
    if digest != protocol.digest:
        told = "; ".join(differences(file, record["file"])[:3]) or "its tables or their entries stand in another order"
        raise UsageError(
            f"out is {store.url}, which was begun with another file: {told}. Put that back, or name another folder"
        )
    told = "; ".join(differences(known, record["draws"])[:1])
    require(
        not told,
        f"out is {store.url}, which was begun with other draws of the same file, as another version of SciPy makes "
        f"them: {told}. Install that version again, or name another folder",
    )
    return drawn


def differences(there: Any, here: Any, where: str = "") -> list[str]:
    """List the differences between what a folder was begun with and a file, each place in a few words."""
    if isinstance(there, dict) and isinstance(here, dict):
        inner = where and f"{where}."
        names = [*here, *(name for name in there if name not in here)]
        return [
            found
            for name in names
            for found in (
                differences(there[name], here[name], f"{inner}{name}")
                if name in there and name in here
                else [f"{inner}{name} is {'new' if name in here else 'missing'}"]
            )
        ]
    return [] if canonical(there) == canonical(here) else [f"{where} is {here!r} and was {there!r}"]


def load(store: Store, protocol: Protocol) -> Found:
    """Load the folder's finished stages.

    Raises:
        UsageError: it was begun with something else, its draws are not all trained, or a file there is damaged.
    """
    latest: list[Found] = []
    there = FILE in store.names("")
    require(there, f"out is {store.url}, which holds no {FILE}; name the folder of a benchmark")
    train(store, protocol, None, latest.append)
    require(bool(latest), f"out is {store.url}, where tuning is not done; run its benchmark again to go on")
    return latest[-1]


def train(
    store: Store,
    protocol: Protocol,
    carry_out: CarryOut | None,
    tell: Callable[[Found], None],
    shard_width: int | None = None,
) -> bool:
    """Train what is not done of every stage, one after the other, and say whether all is; the lock must be held.

    Args:
        store: the folder.
        protocol: what the folder is begun with.
        carry_out: trains what a plan lacks; where it leaves something of tuning out, the later stages are not begun.
            None leaves out all that is not there.
        tell: is given what there is before a later stage is trained, and in the end.
        shard_width: runs side by side, for plans that are not there yet; by default as `stages.width` has it.

    Raises:
        UsageError: the folder was begun with something else, or is full.
        BrokenEnvironmentError: an environment broke.
    """
    drawn = begin(store, protocol)
    stage = functools.partial(_stage, store, protocol, carry_out, shard_width)
    runs = stage(tuning(protocol, drawn))
    if runs is None:
        return False
    known = made(store)
    speeds = {each.task: known[each.part.name]["steps_per_second"] for each in runs if each.part.name in known}
    found, told = Found(protocol, drawn, runs, speeds=speeds), None
    parts: dict[Stage, list[Part]] = {}
    for part in afterwards(protocol, drawn, found.selected):
        parts.setdefault(part.stage, []).append(part)
    for name, of_stage in parts.items():
        if told is not found and not {_file(part) for part in of_stage} <= {*store.names(DATA)}:
            tell(found)  # before what may take hours
            told = found
        runs = stage(of_stage)
        if runs is not None:
            found = dataclasses.replace(found, later={**found.later, name: runs})
    if told is not found:
        tell(found)
    return found.later.keys() == parts.keys()


def _stage(
    store: Store, protocol: Protocol, carry_out: CarryOut | None, shard_width: int | None, parts: Sequence[Part]
) -> list[Runs] | None:
    """The runs of all parts of a stage, or None if some are left out."""
    done = [_done(store, protocol, part, carry_out, shard_width) for part in parts]
    there = [runs for runs in done if runs is not None]
    return there if len(there) == len(parts) else None


def _file(part: Part) -> str:
    """The name of a part's file in DATA."""
    return f"{part.name}.parquet"


def _done(
    store: Store, protocol: Protocol, part: Part, carry_out: CarryOut | None, shard_width: int | None
) -> Runs | None:
    """The runs of a part, from its file or trained now; None if something is left out."""
    file = f"{DATA}/{_file(part)}"
    if _file(part) in store.names(DATA):
        return Runs.load(store.read(file), part, protocol.digest, f"{file} in {store.url}")
    if carry_out is None:
        return None
    sweeps = train_stage(store, part.name, part.studies, carry_out, shard_width or width)
    if not sweeps:
        return None
    tables = [each.table() for each in sweeps]
    runs = gather(part, tables, protocol.selection)
    known = made(store) | {part.name: {"sweeps": [*map(record_of, tables)], "steps_per_second": _speeds(part, sweeps)}}
    store.write(MADE, written(known))
    store.write(file, runs.save(protocol.digest))
    return runs


def made(store: Store) -> dict[str, Any]:
    """Read how each part was made, by its name, as far as the folder knows."""
    try:
        found = json.loads(store.read(MADE))
        require(isinstance(found, dict), "it holds no table")
        return found
    except FileNotFoundError:
        return {}
    except (ValueError, RecursionError) as error:
        raise UsageError(f"out is {store.url}, whose {MADE} is damaged ({error}); remove that file") from None


def _speeds(part: Part, sweeps: Sequence[Trained]) -> dict[str, float]:
    """Environment steps a second, training and evaluation, of a worker that trains a method's runs side by side.

    Runs that are trained together share their time evenly; in a narrow shard each has more of it than in a wide one.
    """
    costs: dict[Setting, list[tuple[float, float]]] = {}
    for each in sweeps:
        for table in tables_of(each.store, each.plan):
            record, n = record_of(table), table.num_rows
            for i in table.column("setting").to_pylist():
                cost = record["env_steps"] / n, record["train_seconds"] / n
                costs.setdefault(each.plan.study.settings[i], []).append(cost)
    speeds = {}
    for method in dict.fromkeys(entry.method for entry in part.entries):
        own = {entry.setting for entry in part.entries if entry.method == method}
        steps, seconds = np.sum([cost for setting in own for cost in costs[setting]], axis=0).tolist()
        speeds[method] = rounded(steps / max(seconds, 1e-9))
    return speeds


def written(record: Any) -> bytes:
    """A record as a file of JSON; the same bytes for the same record."""
    return (json.dumps(record, indent=1, ensure_ascii=False) + "\n").encode()
