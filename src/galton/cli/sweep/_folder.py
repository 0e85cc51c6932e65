"""The folder of a sweep that was planned: what it holds, and how a command ends that has trained there."""

import dataclasses
from typing import Annotated

import tyro
from rich.console import Console

from galton.cli._sweep_view import winners
from galton.sweep import results
from galton.sweep.plan import Plan
from galton.sweep.store import Store
from galton.sweep.study import import_all


@dataclasses.dataclass(frozen=True)
class Folder:
    """A sweep that was planned."""

    out: tyro.conf.Positional[Annotated[str, tyro.conf.arg(metavar="DIR")]]
    """Its folder, or the address that fsspec opens."""


def load(store: Store) -> Plan:
    """The plan that is there, with its losses and environments registered.

    Raises:
        UsageError: no plan, one that was damaged, or a module that can't be imported.
    """
    plan = Plan.load(store)
    import_all(plan.study.imports)
    return plan


def conclude(store: Store, plan: Plan) -> None:
    """Write the table of all runs that are done, and show the best settings."""
    table = results.collect(store, plan)
    results.save(store, table)
    Console().print(winners(results.best_settings(plan.study, table)))
    runs = f"{table.num_rows:,}" if table.num_rows == plan.n_runs else f"{table.num_rows:,} of {plan.n_runs:,}"
    print(f"{runs} runs: {store.url}/{results.FILE}")
