"""galton sweep rerun: the best settings again, on seeds that had no part in choosing them."""

import dataclasses
from collections.abc import Sequence

from galton.cli._reading import read_options
from galton.errors import require
from galton_experiments.commands.sweep._folder import Folder, conclude, load
from galton_experiments.sweep import engine, results
from galton_experiments.sweep.executors import one_per_core
from galton_experiments.sweep.store import Store
from galton_experiments.sweep.view import workers


@dataclasses.dataclass(frozen=True)
class Options(Folder):
    """Train the best setting of each loss again on fresh seeds: the best of many flatters."""

    to: str
    """The folder for it."""
    trials: int = 20
    """Runs of each setting."""
    seed: int = 1
    """Of the study; not the sweep's own."""
    workers: int | None = None
    """Processes, by default one per core."""
    extend: bool = False
    """Add more trials to a folder that has some."""


def main(arguments: Sequence[str]) -> None:
    """Find the winners of a sweep that is done, and train them as a sweep of their own."""
    options = read_options(Options, "sweep rerun", arguments)
    source, target = Store(options.out), Store(options.to)
    require(options.out != options.to, f"to is {options.to!r}, the sweep's own folder; name another")
    known = load(source, options.imports, to_train=True)
    table = results.collect(source, known)
    missing = known.n_runs - table.num_rows
    require(not missing, f"out is {options.out}, where {missing:,} runs are missing; run the sweep to its end first")
    best = results.best_settings(known.study, table)
    study = results.rerun(known.study, best, options.trials, options.seed)
    with target.lock():
        plan = engine.prepare(target, study, known.shard_width, options.extend)
        with workers(one_per_core(options.workers)) as carry_out:
            carry_out(target, plan)
        conclude(target, plan)
