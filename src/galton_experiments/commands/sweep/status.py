"""galton sweep status: what is done, by the files that are there."""

from collections.abc import Sequence

import numpy as np
from rich.table import Table

from galton.cli._progress import plain_console
from galton.cli._reading import read_options
from galton.losses import find_loss
from galton_experiments.commands.sweep._folder import Folder as Options
from galton_experiments.commands.sweep._folder import load
from galton_experiments.sweep.plan import Plan
from galton_experiments.sweep.shard import finished
from galton_experiments.sweep.store import Store
from galton_experiments.sweep.study import Setting


def main(arguments: Sequence[str]) -> None:
    """Show how many shards and runs of each program are done."""
    options = read_options(Options, "sweep status", arguments)
    store = Store(options.out)
    plan = load(store, options.imports)
    done = finished(store, plan)
    table = Table("program", "shards done", "runs done")
    of_program: dict[str, list[int]] = {}
    for index, setting in enumerate(plan.firsts):
        of_program.setdefault(_program(setting), []).append(index)
    for name, shards in of_program.items():
        there = [index for index in shards if index in done]
        table.add_row(
            name,
            f"{len(there):,} of {len(shards):,}",
            f"{_n_runs(plan, there):,} of {_n_runs(plan, shards):,}",
        )
    print(f"{store.url}: {plan.study.env}")
    plain_console().print(table)
    print(
        f"{len(done):,} of {plan.n_shards:,} shards, {_n_runs(plan, list(done)):,} of {plan.n_runs:,} runs",
    )


def _program(setting: Setting) -> str:
    loss = str(setting["loss"])
    return f"{loss}, k = {setting['n_bins']}" if find_loss(loss).family == "histogram" else loss


def _n_runs(plan: Plan, shards: Sequence[int]) -> int:
    return int(np.diff(plan.bounds)[list(shards)].sum())
