"""The folder of a sweep that was planned: what it holds, and how a command ends that has trained there."""

import dataclasses
import sys
from collections.abc import Sequence
from typing import Annotated

import numpy as np
import tyro
from rich.table import Table

from galton.cli._progress import plain_console
from galton.cli._reading import import_typed
from galton.decimals import fitting
from galton.errors import UsageError
from galton.extras import import_all
from galton.losses import find_loss
from galton_experiments.sweep import results
from galton_experiments.sweep.parquet import record_of
from galton_experiments.sweep.plan import Plan
from galton_experiments.sweep.results import Best
from galton_experiments.sweep.store import Store
from galton_experiments.sweep.study import Study


@dataclasses.dataclass(frozen=True)
class Folder:
    """A sweep that was planned."""

    out: tyro.conf.Positional[Annotated[str, tyro.conf.arg(metavar="DIR")]]
    """Its folder, or the address that fsspec opens."""
    imports: tuple[str, ...] = dataclasses.field(default=(), kw_only=True)
    """Modules to import first. One that the sweep names and that lies in the current folder must be given."""


def import_of_file(modules: Sequence[str]) -> None:
    """Import modules that a file names, unless they were typed; UsageError for one that can't be, with what to do."""
    found = [path for path in sys.path if path == ""]
    sys.path[:] = [path for path in sys.path if path != ""]
    try:
        import_all(modules)
    except UsageError as error:
        raise UsageError(
            f"{error}. It is named by a file, for which the current folder is not searched: if it lies there and you "
            f"trust it, give --imports {' '.join(modules)}"
        ) from None
    finally:
        sys.path += found


def load(store: Store, imports: Sequence[str], *, to_train: bool = False) -> Plan:
    """The plan that is there, with its losses and environments registered.

    Args:
        store: the folder.
        imports: modules that the command line names.
        to_train: whether the module of its environment is needed too.

    Raises:
        UsageError: no plan, one that was damaged, or a module that can't be imported.
    """
    import_typed(imports)
    import_of_file(Plan.imports(store))
    plan = Plan.load(store)
    import_of_file(plan.study.modules if to_train else ())
    return plan


def conclude(store: Store, plan: Plan) -> None:
    """Write the table of all runs that are done, and show the best settings."""
    table = results.collect(store, plan)
    try:
        results.save(store, table)
    finally:  # who can't write here may read all the same
        plain_console().print(winners(plan.study, results.best_settings(plan.study, table)))
    runs = f"{table.num_rows:,}" if table.num_rows == plan.n_runs else f"{table.num_rows:,} of {plan.n_runs:,}"
    print(f"{runs} runs: {store.url}/{results.FILE}")
    made_by = record_of(table)["versions"]
    if len(made_by) > 1:
        names = sorted(name for name in {name for one in made_by for name in one} if name.isidentifier())
        changed = [name for name in names if any(one.get(name) != made_by[0].get(name) for one in made_by)]
        print(
            f"galton: {len(made_by)} versions of the code trained these runs; they differ in {', '.join(changed)}",
            file=sys.stderr,
        )


def winners(study: Study, best: dict[str, Best]) -> Table:
    """A table of a study's best settings, a row for each loss; those without a return are in no mean, but counted."""
    from galton_experiments.analysis.statistics import mean_interval  # scipy takes a second, which `status` needn't

    table = Table(title="best setting per loss, by mean final training return: mean and 95% CI")
    lost = {loss: int(np.isnan(winner.final_training_return).sum()) for loss, winner in best.items()}
    some = ["no return"] * any(lost.values())
    for heading in ("loss", "setting", "training return", "evaluation return", *some, "of settings"):
        table.add_column(heading, justify="left" if heading in ("loss", "setting") else "right")
    for loss, winner in best.items():
        training, evaluation = (
            f"{mean_interval(values):{fitting(*values)}}"
            for values in (winner.final_training_return, winner.final_evaluation_return)
        )
        setting, counts = winner.setting.brief(study.varied), (*[lost[loss]] * len(some), winner.n_settings)
        table.add_row(find_loss(loss).label, setting, training, evaluation, *map(str, counts))
    return table
