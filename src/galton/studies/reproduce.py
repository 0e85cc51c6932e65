"""What figures need, trained: each sweep in a folder of its own, then as a summary of a megabyte or less."""

from collections.abc import Iterable

import pyarrow as pa

from galton.errors import UsageError
from galton.saving.provenance import machine, versions
from galton.studies.base import Data
from galton.studies.gradients import collect
from galton.studies.summary import Summary
from galton.studies.sweeps import SWEEPS, Budget, find_sweep
from galton.sweep import engine, results
from galton.sweep.engine import CarryOut
from galton.sweep.parquet import from_bytes, record_of, to_bytes, with_record
from galton.sweep.shard import provenance
from galton.sweep.store import Store

DATA = "data"
"""The folder of summaries."""
PROPOSITIONS = "propositions.parquet"
"""What was measured of the propositions, there."""


def needed(sweeps: Iterable[str]) -> list[str]:
    """These sweeps and what they need, that first."""
    found: dict[str, None] = {}
    for name in sweeps:
        found |= dict.fromkeys([*needed(find_sweep(name).needs), name])
    return list(found)


def load(out: str) -> Data:
    """What a folder holds.

    Raises:
        UsageError: a file there is damaged, or something else.
    """
    store = Store(f"{out}/{DATA}")
    files = store.names("")
    sweeps = {name: Summary.load(store, f"{name}.parquet") for name in SWEEPS if f"{name}.parquet" in files}
    if PROPOSITIONS not in files:
        return Data(sweeps)
    try:
        table = from_bytes(store.read(PROPOSITIONS))
        record_of(table)
    except (pa.ArrowException, OSError, KeyError, TypeError, ValueError) as error:
        raise UsageError(f"{PROPOSITIONS} in {store.url} is not what was measured, or was damaged: {error}") from None
    return Data(sweeps, table)


def refuse_other_budgets(sweeps: Iterable[str], propositions: bool, budget: Budget, out: str) -> None:
    """So that nothing is trained for a folder that has some of it at another budget.

    Raises:
        UsageError: it has.
    """
    data = load(out)
    made = {name: data.sweeps[name].provenance["budget"] for name in needed(sweeps) if name in data.sweeps}
    if propositions and data.propositions is not None:
        made[PROPOSITIONS.removesuffix(".parquet")] = record_of(data.propositions)["budget"]
    for name, other in made.items():
        if other != budget:
            raise UsageError(
                f"out is {out}, whose {name} was made with budget {other!r}, not {budget!r}; name another folder, or "
                f"remove {DATA}/{name}.parquet there"
            )


def measure_propositions(budget: Budget, out: str) -> None:
    """Unless the folder has them: train networks and measure both sides of both bounds on them."""
    if load(out).propositions is None:
        record = {"budget": budget, "versions": [versions()], "machines": [machine()]}
        Store(f"{out}/{DATA}").write(PROPOSITIONS, to_bytes(with_record(collect(budget), record)))


def train(sweeps: Iterable[str], budget: Budget, out: str, carry_out: CarryOut) -> None:
    """Do what is not done yet.

    Args:
        sweeps: keys of SWEEPS; what they need comes first.
        budget: how much of each.
        out: summaries go to its folder `data`, the runs to `sweeps`; a run needs no second training, and with its
            summary there a sweep needs no runs.
        carry_out: what trains.

    Raises:
        UsageError: the folder holds a sweep that is not the one asked for, or is in use, or full.
    """
    done = dict(load(out).sweeps)
    for name in needed(sweeps):
        sweep = find_sweep(name)
        study = sweep.study(budget, done)
        if name in done:
            if done[name].study != study:
                raise UsageError(
                    f"out is {out}, whose {name} is of another study than this version and budget {budget!r} ask for; "
                    f"name another folder, or remove {DATA}/{name}.parquet there"
                )
            continue
        store = Store(f"{out}/sweeps/{name}")
        with store.lock():
            plan = engine.prepare(store, study, 4 if budget == "smoke" else None, extend=False)  # few programs
            carry_out(store, plan)
            table: pa.Table = results.collect(store, plan)
            done[name] = Summary.of_results(study, table, {"budget": budget} | provenance(store, plan))
        done[name].save(Store(f"{out}/{DATA}"), f"{name}.parquet")
