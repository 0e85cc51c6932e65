"""galton benchmark: methods compared by a protocol that one file has fixed before anything is trained."""

import dataclasses
from collections.abc import Sequence
from pathlib import Path
from typing import Annotated

import tyro
from rich import box
from rich.console import Console
from rich.table import Table as View

from galton.cli._progress import plain_console
from galton.cli._reading import import_typed, read_options
from galton.envs.registry import module_of
from galton.errors import UsageError, require, require_integer
from galton_experiments.benchmark import factorial_page, report, stages, tables
from galton_experiments.benchmark.answer import sentences
from galton_experiments.benchmark.draws import draws
from galton_experiments.benchmark.folder import train
from galton_experiments.benchmark.found import Found
from galton_experiments.benchmark.protocol import Protocol
from galton_experiments.benchmark.reading import read
from galton_experiments.commands.sweep._folder import import_of_file
from galton_experiments.commands.sweep._workers import Workers
from galton_experiments.page.page import Table
from galton_experiments.sweep.engine import CarryOut
from galton_experiments.sweep.plan import Plan
from galton_experiments.sweep.shard import finished
from galton_experiments.sweep.store import Store


@dataclasses.dataclass(frozen=True)
class Options:
    """Tune methods with equal budgets, judge them on fresh seeds and held-out tasks, and write the report.

    Run it again to go on where it stopped. docs/benchmark.md says what the file holds.
    """

    file: tyro.conf.Positional[Annotated[Path, tyro.conf.arg(metavar="FILE.toml")]]
    """The protocol: methods, prior, tasks, budget and how settings are selected."""
    out: str | None = None
    """The folder, by default runs/benchmark-FILE; or an address that fsspec opens, such as s3://bucket/folder."""
    shard_width: int | None = None
    """Runs that are trained side by side by one worker, for what is not planned yet; by default as make
    shards few and even, up to 16 on Galton's own environments and 32 on others."""
    plan_only: bool = False
    """Write the plans of tuning, or of the later stages, and stop: their shards are for `galton sweep shard`."""
    imports: tuple[str, ...] = ()
    """Modules to import first. One that the file names and that lies in the current folder must be given."""
    workers: Workers = dataclasses.field(default_factory=Workers)

    @property
    def folder(self) -> str:
        """The folder or address of all that is written."""
        return self.out or str(Path("runs", f"benchmark-{self.file.stem}"))


def main(arguments: Sequence[str]) -> None:
    """Read the file, check all that it asks for, train what is not done yet, and write and show the report."""
    options = read_options(Options, "benchmark", arguments)
    options.workers.check()
    if options.shard_width is not None:
        require_integer("shard_width", options.shard_width, 1)
    import_typed(options.imports)
    protocol = read(options.file, import_of_file)
    of_tasks = [module for task in protocol.tasks for module in module_of(task.env)]
    import_of_file(list(dict.fromkeys(of_tasks)))
    more = " ".join(sorted(set(options.imports) - {*protocol.imports, *of_tasks}))
    require(not more, f"imports is {more}, which no worker would import; name it among the imports of {options.file}")
    try:
        stages.check(protocol, draws(protocol))
    except UsageError as error:
        raise UsageError(f"file is {str(options.file)!r}: {error}") from None
    store = Store(options.folder)
    latest: list[Found] = []

    def tell(found: Found) -> None:
        latest[:] = [found]
        report.write(store, found)

    with store.lock():
        if options.plan_only:
            done = train(store, protocol, _planned, tell, options.shard_width)
        else:
            with options.workers.hired() as carry_out:
                done = train(store, protocol, _told(carry_out), tell, options.shard_width)
    _show(protocol, latest, store, done)


def _told(carry_out: CarryOut) -> CarryOut:
    """The same, but it says first what it goes on with."""

    def told(store: Store, plan: Plan) -> None:
        print(f"{store.url}:")
        carry_out(store, plan)

    return told


def _planned(store: Store, plan: Plan) -> None:
    """Say what is left of a plan; who trains it is the user's business."""
    left = plan.n_shards - len(finished(store, plan))
    if left:
        print(f"{left:,} of {plan.n_shards:,} shards are left: {store.url}")


def _show(protocol: Protocol, latest: list[Found], store: Store, done: bool) -> None:
    """Print the answer and the tables of what is done."""
    console, base = plain_console(), protocol.baseline.label
    for found in latest:
        _print(console, "what each method was given", tables.budget(found))
        if protocol.design == "factorial":
            _print(console, f"P(above {base}) by {tables.metric(found)}", factorial_page.above(found))
            _print(console, f"P(above {base}) on each task", factorial_page.above_by_task(found))
        for stage in found.standings:
            title, metric = tables.STAGES[stage], tables.metric(found)
            _print(console, f"scores by {metric}: {title}, baseline {base}", tables.scores(found, stage))
            _print(console, f"{metric}: {title}, compared with {base}", tables.returns_in_brief(found, stage))
        best_of = factorial_page.best_of if protocol.design == "factorial" else tables.best_of
        _print(console, "score of the best of n draws", best_of(found))
        _print(console, "environment steps a second of a worker, tuning", tables.speeds(found))
        console.print("\n".join(sentences(found)))
        print(f"report: {store.url}/{report.PAGE}")
    if not done:
        print(f"{protocol.title}: there is more to train; the same command goes on")


def _print(console: Console, title: str, table: Table) -> None:
    """A table on the terminal, below its title."""
    view = View(box=box.SIMPLE_HEAD, pad_edge=False, padding=(0, 1, 0, 0))
    for i, heading in enumerate(table.headings):
        width = max(map(len, heading.split()))
        view.add_column(heading, justify="right" if table.is_numeric(i) else "left", no_wrap=i == 0, min_width=width)
    for row in table.rows:
        view.add_row(*row)
    console.print(title)
    console.print(view, crop=False)
