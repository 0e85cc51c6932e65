"""galton sweep: a grid of settings × trials, planned on disk and carried out by workers that may die."""

import contextlib
import dataclasses
import re
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Annotated, Literal

import numpy as np
import tyro
from rich.console import Console
from rich.table import Table

from galton.commands._options import EnvName, Training, parse, short_name
from galton.commands.carry import carry, processes
from galton.commands.sweep_view import winners
from galton.errors import require, require_integer
from galton.losses import find_loss
from galton.sweep import engine, results
from galton.sweep.engine import CarryOut
from galton.sweep.executors import Place, one_per_core, one_per_gpu
from galton.sweep.grid import GRIDS, find_grid
from galton.sweep.plan import Plan
from galton.sweep.shard import discard, finished, read, work
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
    """The folder, by default runs/sweep-ENV, or runs/sweep-ENV-optuna for Optuna's search; or an address that fsspec
    opens, such as s3://bucket/folder."""
    shard_width: int | None = None
    """Runs that are trained side by side by one worker; by default 16, or 32 on environments outside JAX, but no more
    than share a program."""
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
    options = parse(Options, "sweep", arguments, lambda options: import_all(options.imports))
    training = options.training
    base = Setting(training.config, training.hypers).record()
    training.find(options.env)

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

    folder = f"sweep-{short_name(options.env)}" + ("-optuna" if options.grid == "optuna" else "")
    store = Store(options.out or str(Path("runs", folder)))
    _check_carrier(options)
    if options.shard_width is not None:
        require_integer("shard_width", options.shard_width, 1)
    if options.grid == "optuna":
        require(not options.plan_only, "plan_only goes without grid 'optuna', whose plan grows with what it finds")
        study_of((Setting(training.config, training.hypers),))  # wrong numbers are told before anything is written
        with store.lock(), _carrier(options, store) as carry_out:
            from galton.sweep.search import search

            rounds: list[tuple[Setting, ...]] = []

            def means(settings: tuple[Setting, ...]) -> dict[Setting, float]:
                rounds.append(settings)
                engine.prepare(store, study_of(rounds[0]), options.shard_width, options.extend)
                plan = engine.prepare(store, study_of(settings), options.shard_width, extend=True)
                carry_out(store, plan)
                return results.mean_returns(plan.study, results.collect(store, plan))

            search(means, base, options.n_settings, options.batch, options.seed)
            _conclude(Console(), store, Plan.load(store))
        return
    study = study_of(find_grid(options.grid, options.env, base, options.n_settings))
    with store.lock():
        plan = engine.prepare(store, study, options.shard_width, options.extend)
        if options.plan_only:
            print(f"{plan.n_runs:,} runs in {plan.n_shards:,} shards: {store.url}")
            return
        with _carrier(options, store) as carry_out:
            carry_out(store, plan)
        _conclude(Console(), store, plan)


def _check_carrier(options: Options) -> None:
    require(
        not (options.scheduler and options.cluster),
        f"scheduler is {options.scheduler!r} and cluster {options.cluster!r}; give one of them",
    )
    far = bool(options.scheduler or options.cluster)
    _go_with(options, ("n_settings",), options.grid in ("random", "optuna"), "grid 'random' or 'optuna'")
    _go_with(options, ("batch",), options.grid == "optuna", "grid 'optuna'")
    _go_with(options, ("workers",), not (options.gpus or far), "processes here, without gpus, scheduler or cluster")
    _go_with(options, ("gpus",), not far, "processes here, without scheduler or cluster")
    _go_with(options, ("tls",), far, "a scheduler or a cluster")
    _go_with(options, ("jobs", "walltime", "memory", "directives"), options.cluster is not None, "a cluster")
    _places(options)
    right = re.fullmatch(r"\d+:\d\d:\d\d", options.walltime) is not None
    require(right, f"walltime is {options.walltime!r}; write 12:00:00")
    for line in options.directives:
        right = options.cluster != "htcondor" or "=" in line
        require(right, f"directives holds {line!r}; for HTCondor each is NAME=VALUE")


def _go_with(options: Options, names: Sequence[str], they_do: bool, what: str) -> None:
    for name in names:
        value = getattr(options, name)
        require(they_do or value == getattr(Options, name), f"{name} is {value}; it goes with {what}")


def _places(options: Options) -> list[Place]:
    return one_per_gpu(options.gpus) if options.gpus else one_per_core(options.workers)


@contextlib.contextmanager
def _carrier(options: Options, store: Store) -> Iterator[CarryOut]:
    """What carries plans out where the options say."""
    if not (options.scheduler or options.cluster):
        with processes(_places(options)) as carry_out:
            yield carry_out
        return
    from galton.sweep import cluster

    if options.scheduler:
        carrier = cluster.connect(options.scheduler, options.tls)
    else:
        jobs = cluster.Jobs(options.jobs, options.walltime, options.memory, options.directives)
        carrier = cluster.start(str(options.cluster), jobs, store.local or Path.cwd(), options.tls)
    with carrier as (executor, width):
        yield lambda store, plan: carry(Store(store.absolute), plan, executor, width, cluster.LOST)


def _conclude(console: Console, store: Store, plan: Plan) -> None:
    table = results.collect(store, plan)
    results.save(store, table)
    console.print(winners(results.best_settings(plan.study, table)))
    runs = f"{table.num_rows:,}" if table.num_rows == plan.n_runs else f"{table.num_rows:,} of {plan.n_runs:,}"
    console.print(f"{runs} runs: {store.url}/{results.FILE}", highlight=False, soft_wrap=True)


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
    done = finished(store, plan).get(options.index)
    if done and read(store, done) is not None:
        print(f"shard {options.index} is done already")
        return
    if done:
        discard(store, done)
    report = work(store.url, options.index)
    print(f"shard {options.index}: {len(report.setting)} runs in {report.train_seconds:,.1f} s")


def rerun(arguments: Sequence[str]) -> None:
    """The winners, again."""
    options = tyro.cli(Rerun, prog="galton sweep rerun", args=list(arguments))
    source, target = Store(options.out), Store(options.to)
    require(options.out != options.to, f"to is {options.to!r}, the sweep's own folder; name another")
    known = _load(source)
    table = results.collect(source, known)
    missing = known.n_runs - table.num_rows
    require(not missing, f"out is {options.out}, where {missing:,} runs are missing; run the sweep to its end first")
    best = results.best_settings(known.study, table)
    study = results.rerun(known.study, best, options.trials, options.seed)
    with target.lock():
        plan = engine.prepare(target, study, known.shard_width, extend=False)
        with processes(one_per_core(options.workers)) as carry_out:
            carry_out(target, plan)
        _conclude(Console(), target, plan)


_OTHERS: dict[str, Callable[[Sequence[str]], None]] = {
    "status": status,
    "results": show_results,
    "shard": one_shard,
    "rerun": rerun,
}
