"""galton sweep: a grid of settings × trials, planned on disk and carried out by workers that may die."""

import contextlib
import dataclasses
import re
import sys
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import Executor
from pathlib import Path
from typing import Annotated, Literal

import numpy as np
import tyro
from rich.console import Console
from rich.table import Table

from galton.commands.common import EnvName, Training, parse, short_name
from galton.commands.sweep_view import live, winners
from galton.envs.base import Environment
from galton.errors import UsageError, require, require_integer
from galton.losses import find_loss
from galton.sweep import engine, results
from galton.sweep.executors import Place, Processes, one_per_core, one_per_gpu
from galton.sweep.grid import GRIDS, find_grid
from galton.sweep.plan import Plan
from galton.sweep.shard import finished, work
from galton.sweep.store import Store
from galton.sweep.study import Setting, Study, import_all


@dataclasses.dataclass(frozen=True)
class Options:
    """Train every setting of a grid many times. Run it again to go on where it stopped.

    Also: `galton sweep status DIR`, `results DIR`, `rerun DIR --to DIR`, `shard DIR INDEX`.
    """

    env: EnvName
    training: Training
    grid: Annotated[str, tyro.conf.arg(metavar="{" + ",".join(GRIDS) + ",optuna} or FILE.toml")] = "paper"
    """The settings: the paper's (App. C.2), random ones around them, what Optuna proposes, or the [[grid]] tables of a
    file."""
    n_settings: int = 16
    """Settings per loss of the random grid and of Optuna's search."""
    batch: int = 4
    """Settings per loss that Optuna proposes before it hears of their results."""
    trials: int = 20
    """Runs per setting."""
    seed: int = 0
    """Of the study: another one gives every run a fresh seed."""
    out: str | None = None
    """The folder, by default runs/sweep-ENV; or an address that fsspec opens, such as s3://bucket/folder."""
    shard_width: int | None = None
    """Runs that are trained side by side by one worker; by default 16, or 32 on environments outside JAX."""
    extend: bool = False
    """Add to the plan that the folder holds what it lacks of this grid."""
    plan_only: bool = False
    """Write the plan and stop: its shards are for `galton sweep shard`."""
    workers: int | None = None
    """Processes, by default one per core."""
    gpus: int = 0
    """A process for each of so many CUDA devices instead; give a --shard-width of thousands with it."""
    scheduler: str | None = None
    """A Dask scheduler that runs, such as tls://host:8786: its workers train, instead of processes here."""
    cluster: Annotated[Literal["htcondor", "slurm", "pbs"] | None, tyro.conf.arg(metavar="{htcondor,slurm,pbs}")] = None
    """A batch system to start such workers with, from a login node."""
    jobs: int = 10
    """How many of them; each is one core."""
    walltime: str = "12:00:00"
    """Of each job."""
    memory: str = "2GB"
    """Of each job."""
    directives: tuple[str, ...] = ()
    """Further lines for the batch system, such as its account; for HTCondor NAME=VALUE."""
    tls: Path | None = None
    """A folder with ca.pem, cert.pem and key.pem: encrypt and authenticate all that goes to workers and back."""
    imports: tuple[str, ...] = ()
    """Modules that every worker imports first, where losses or environments of your own are registered."""


def main(arguments: Sequence[str]) -> None:
    """Plan, train, and keep the results; or one of the smaller commands."""
    if arguments and arguments[0] in _OTHERS:
        _OTHERS[arguments[0]](arguments[1:])
        return
    options = parse(Options, "sweep", arguments)
    import_all(options.imports)
    training = options.training
    base = Setting(training.config, training.hypers).record()
    known = isinstance(training.find(options.env), Environment)
    shard_width = options.shard_width if options.shard_width is not None else 16 if known else 32

    def study_of(settings: tuple[Setting, ...]) -> Study:
        return Study(
            options.env,
            settings,
            options.trials,
            training.steps,
            training.logs,
            training.eval_episodes,
            training.env_kwargs,
            options.seed,
            options.imports,
        )

    store = Store(options.out or str(Path("runs", f"sweep-{short_name(options.env)}")))
    _check_carrier(options)
    require_integer("shard_width", shard_width, 1)
    if options.grid == "optuna":
        require(not options.plan_only, "plan_only goes without grid 'optuna', whose plan grows with what it finds")
        study_of((Setting(training.config, training.hypers),))  # wrong numbers are told before anything is written
        with store.lock(), _carrier(options, store) as carry_out:
            from galton.sweep.search import search

            def means(settings: tuple[Setting, ...]) -> dict[Setting, float]:
                plan = engine.prepare(store, study_of(settings), shard_width, extend=True)
                carry_out(plan)
                return results.mean_returns(plan.study, results.collect(store, plan))

            search(means, base, options.n_settings, options.batch, options.seed)
            _conclude(Console(), store, Plan.load(store))
        return
    study = study_of(find_grid(options.grid, options.env, base, options.n_settings))
    with store.lock():
        plan = engine.prepare(store, study, shard_width, options.extend)
        if options.plan_only:
            print(f"{plan.n_runs:,} runs in {plan.n_shards:,} shards: {store.url}")
            return
        with _carrier(options, store) as carry_out:
            carry_out(plan)
        _conclude(Console(), store, plan)


def _check_carrier(options: Options) -> None:
    require(
        not (options.scheduler and options.cluster),
        f"scheduler is {options.scheduler!r} and cluster {options.cluster!r}; give one of them",
    )
    far = "scheduler" if options.scheduler else "cluster" if options.cluster else None
    require(far is None or options.workers is None, f"workers is {options.workers}, which goes without a {far}")
    require(far is None or not options.gpus, f"gpus is {options.gpus}, which goes without a {far}")
    require(far is not None or options.tls is None, f"tls is {options.tls}; it goes with a scheduler or a cluster")
    _places(options)
    right = re.fullmatch(r"\d+:\d\d:\d\d", options.walltime) is not None
    require(right, f"walltime is {options.walltime!r}; write 12:00:00")
    for line in options.directives:
        right = options.cluster != "htcondor" or "=" in line
        require(right, f"directives holds {line!r}; for HTCondor each is NAME=VALUE")


def _places(options: Options) -> list[Place]:
    return one_per_gpu(options.gpus) if options.gpus else one_per_core(options.workers)


@contextlib.contextmanager
def _carrier(options: Options, store: Store) -> Iterator[Callable[[Plan], None]]:
    """What carries plans out where the options say."""
    if not (options.scheduler or options.cluster):
        with _processes(store, _places(options)) as carry_out:
            yield carry_out
        return
    from galton.sweep import cluster

    if options.scheduler:
        carrier = cluster.connect(options.scheduler, options.tls)
    else:
        jobs = cluster.Jobs(options.jobs, options.walltime, options.memory, options.directives)
        carrier = cluster.start(str(options.cluster), jobs, store.local or Path.cwd(), options.tls)
    with carrier as (executor, width):
        yield lambda plan: _carry_out(Store(store.absolute), plan, executor, width, cluster.LOST)


@contextlib.contextmanager
def _processes(store: Store, places: Sequence[Place]) -> Iterator[Callable[[Plan], None]]:
    executor = Processes(places)
    try:
        yield lambda plan: _carry_out(store, plan, executor, lambda: len(places))
    finally:
        executor.shutdown(cancel_futures=True)


def _carry_out(
    store: Store,
    plan: Plan,
    executor: Executor,
    width: Callable[[], int],
    lost: tuple[type[BaseException], ...] = (),
) -> None:
    try:
        with live(Console(), plan) as view:
            engine.run(store, plan, executor, width, view, lost=lost)
    except KeyboardInterrupt:
        print(
            f"galton: interrupted; {len(finished(store, plan)):,} of {plan.n_shards:,} shards are done, and the same "
            "command goes on with the rest",
            file=sys.stderr,
        )
        sys.exit(130)


def _conclude(console: Console, store: Store, plan: Plan) -> None:
    table = results.collect(store, plan)
    results.save(store, table)
    console.print(winners(results.best_settings(plan.study, table)))
    console.print(f"{table.num_rows:,} runs: {store.url}/{results.FILE}", highlight=False, soft_wrap=True)


@dataclasses.dataclass(frozen=True)
class Folder:
    """A sweep that was planned."""

    out: tyro.conf.Positional[str]
    """Its folder."""


@dataclasses.dataclass(frozen=True)
class Shard(Folder):
    """Train one shard of a planned sweep, as one task of a job array."""

    index: tyro.conf.Positional[int]
    """From 0 to the number of shards − 1."""


@dataclasses.dataclass(frozen=True)
class Rerun(Folder):
    """Train the best setting of each loss again on fresh seeds: the best of many flatters."""

    to: str
    """The folder for it."""
    trials: int = 20
    """Runs per setting."""
    seed: int = 1
    """Of the study; not the sweep's own."""
    workers: int | None = None
    """Processes, by default one per core."""


def _load(store: Store) -> Plan:
    plan = Plan.load(store)
    import_all(plan.study.imports)
    return plan


def status(arguments: Sequence[str]) -> None:
    """What is done, by the files that are there."""
    store = Store(tyro.cli(Folder, prog="galton sweep status", args=list(arguments)).out)
    plan = _load(store)
    done = finished(store, plan)
    sizes = np.diff(plan.bounds)
    table = Table("program", "shards done", "runs done", title=f"{store.url}: {plan.study.env}")
    programs: dict[str, list[int]] = {}
    for index, config in enumerate(plan.configs):
        policy = find_loss(config.loss).policy
        name = f"{config.loss}, k = {config.n_bins}" if policy == "histogram" else config.loss
        counts = programs.setdefault(name, [0, 0, 0, 0])
        counts[1] += 1
        counts[3] += int(sizes[index])
        if index in done:
            counts[0] += 1
            counts[2] += int(sizes[index])
    for name, (shards, of_shards, runs, of_runs) in programs.items():
        table.add_row(name, f"{shards:,} of {of_shards:,}", f"{runs:,} of {of_runs:,}")
    runs = sum(counts[2] for counts in programs.values())
    console = Console()
    console.print(table)
    console.print(f"{len(done):,} of {plan.n_shards:,} shards, {runs:,} of {plan.n_runs:,} runs", highlight=False)


def show_results(arguments: Sequence[str]) -> None:
    """The table of all runs that are done, and the best settings."""
    store = Store(tyro.cli(Folder, prog="galton sweep results", args=list(arguments)).out)
    _conclude(Console(), store, _load(store))


def one_shard(arguments: Sequence[str]) -> None:
    """Train one, unless it is done."""
    options = tyro.cli(Shard, prog="galton sweep shard", args=list(arguments))
    store = Store(options.out)
    plan = Plan.load(store)
    plan.get(options.index)
    if options.index in finished(store, plan):
        print(f"shard {options.index} is done already")
        return
    report = work(store.url, options.index)
    print(f"shard {options.index}: {len(report.setting)} runs in {report.train_seconds:,.1f} s")


def rerun(arguments: Sequence[str]) -> None:
    """The winners, again."""
    options = tyro.cli(Rerun, prog="galton sweep rerun", args=list(arguments))
    source, target = Store(options.out), Store(options.to)
    require(options.out != options.to, f"to is {options.to!r}, the sweep's own folder; name another")
    known = _load(source)
    best = results.best_settings(known.study, results.collect(source, known))
    if not best:
        raise UsageError(f"out is {options.out}, where no setting has all its trials yet; run the sweep to its end")
    study = results.rerun(known.study, best, options.trials, options.seed)
    with target.lock():
        plan = engine.prepare(target, study, known.shard_width, extend=False)
        with _processes(target, one_per_core(options.workers)) as carry_out:
            carry_out(plan)
        _conclude(Console(), target, plan)


_OTHERS: dict[str, Callable[[Sequence[str]], None]] = {
    "status": status,
    "results": show_results,
    "shard": one_shard,
    "rerun": rerun,
}
