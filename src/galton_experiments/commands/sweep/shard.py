"""galton sweep shard: one shard of a plan, as one task of a job array."""

import dataclasses
from collections.abc import Sequence

import tyro

from galton.cli._reading import read_options
from galton.devices import use_all_cores
from galton_experiments.commands.sweep._folder import Folder, load
from galton_experiments.sweep.shard import discard, finished, read, work
from galton_experiments.sweep.store import Store


@dataclasses.dataclass(frozen=True)
class Options(Folder):
    """Train one shard of a planned sweep, as one task of a job array."""

    index: tyro.conf.Positional[int]
    """From 0 to the number of shards − 1."""


def main(arguments: Sequence[str]) -> None:
    """Train the shard, unless it is done."""
    options = read_options(Options, "sweep shard", arguments)
    use_all_cores()  # before a module that the plan names computes something
    store = Store(options.out)
    plan = load(store, options.imports, to_train=True)
    plan.get(options.index)
    done = finished(store, plan).get(options.index)
    if done and read(store, done) is not None:
        print(f"shard {options.index} is done already")
        return
    if done:
        discard(store, done)
    report = work(store.url, options.index)
    print(f"shard {options.index}: {len(report.setting)} runs in {report.train_seconds:,.1f} s")
