"""A plan carried out: shards that are not done go to an executor until all are."""

import collections
import concurrent.futures
import time
from collections.abc import Callable, Iterable, Sequence
from concurrent.futures import Executor, Future
from typing import NamedTuple, Protocol, runtime_checkable

import pyarrow as pa

from galton.errors import UsageError
from galton_experiments.sweep import results
from galton_experiments.sweep.executors import ATTEMPTS, WorkerDiedError, one_per_core, processes
from galton_experiments.sweep.plan import FILE, Plan
from galton_experiments.sweep.shard import Report, discard, finished, read, report, work
from galton_experiments.sweep.store import Store
from galton_experiments.sweep.study import Program, Study

SWEEPS = "sweeps"
"""The folder of the runs of stages."""
TICK = 0.2
"""Seconds between two looks at who is there to work."""


@runtime_checkable
class CarryOut(Protocol):
    """Workers that train what a plan lacks; `sweep.workers` yields some."""

    def __call__(self, store: Store, plan: Plan) -> None:
        """Train the shards of a plan that its store does not have yet."""


def sweep(
    study: Study,
    out: str | Store,
    *,
    workers: int | CarryOut | None = None,
    shard_width: int | None = None,
    extend: bool = False,
) -> pa.Table:
    """Train the runs of a study that `out` lacks; then the table of them, as `results.collect` tells.

    What `parquet.record_of` reads of the table says how the runs were made: versions, machines, seconds.

    A script that calls this must be one that its workers can import: what it does stands under
    `if __name__ == "__main__":`, losses and environments of its own above.

    Args:
        study: what to train.
        out: the folder for plan and results, of this study alone.
        workers: processes on this machine, by default one per core; or what `sweep.workers` yields.
        shard_width: runs that a worker trains side by side, by default as `Plan.create` has it.
        extend: add to the plan in the folder what it lacks.

    Raises:
        UsageError: the folder is of another study, or in use, or full.
        BrokenEnvironmentError: an environment broke.
    """
    store = out if isinstance(out, Store) else Store(out)
    places = [] if callable(workers) else one_per_core(workers)
    with store.lock():
        plan = prepare(store, study, shard_width, extend)
        if callable(workers):
            workers(store, plan)
        else:
            with processes(places) as executor:
                run(store, plan, executor, lambda: len(places))
        whole = results.collect(store, plan)
        results.save(store, whole)
        return results.of_study(whole, plan.study, study)


class Trained(NamedTuple):
    """A study that was trained: the folder of its runs, and the plan there, which may have more of them."""

    store: Store
    plan: Plan
    study: Study

    def table(self) -> pa.Table:
        """A row for each run of the study, as `results.collect` tells, and in its record how they were made."""
        return results.of_study(results.collect(self.store, self.plan), self.plan.study, self.study)


def train_stage(
    store: Store, name: str, studies: Sequence[Study], carry_out: CarryOut, width: int | Callable[[Study], int] | None
) -> list[Trained]:
    """Train what is not done of studies that belong together; none of them where some of it is left out.

    Each has a folder of its own below `sweeps`, which may be removed once what is kept of its runs is written.

    Args:
        store: the folder of all that is trained.
        name: what the studies are called together.
        studies: what to train.
        carry_out: trains what a plan lacks, or leaves it out.
        width: runs side by side, for plans that are not there yet.

    Raises:
        UsageError: a folder is of another study, or in use, or full.
        BrokenEnvironmentError: an environment broke.
    """
    found = []
    for i, study in enumerate(studies):
        place = store.below(f"{SWEEPS}/{name}" + (f"~{i + 1}" if i else ""))  # no name has a ~
        with place.lock():
            there = FILE in place.names("")
            plan = prepare(place, study, None if there else width(study) if callable(width) else width, extend=False)
            carry_out(place, plan)
        found.append(Trained(place, plan, study))
    return found if all(len(finished(each.store, each.plan)) == each.plan.n_shards for each in found) else []


def prepare(store: Store, study: Study, shard_width: int | None, extend: bool) -> Plan:
    """The plan that the place holds, if it covers the study; else a new one, or a longer one. The lock must be held.

    Raises:
        UsageError: the place holds the plan of another sweep.
    """
    if FILE not in store.names(""):
        plan = Plan.create(study, shard_width)
        plan.save(store)
        return plan
    known = Plan.load(store)
    if shard_width not in (None, known.shard_width):
        raise UsageError(
            f"shard_width is {shard_width}, but the plan in {store.url} has {known.shard_width}; name another folder"
        )
    plan = known.extended(study)
    if plan.n_runs > known.n_runs:
        if not extend:
            raise UsageError(
                f"out is {store.url}, which holds the plan of another sweep: {plan.n_runs - known.n_runs:,} of these "
                "runs are not in it; name another folder or give --extend to add them"
            )
        plan.save(store)
    return plan


def verified(store: Store, plan: Plan) -> list[Report]:
    """Reports of the shards that are done. Files that were damaged are removed."""
    reports = []
    for done in finished(store, plan).values():
        table = read(store, done)
        if table is None:
            discard(store, done)
        else:
            reports.append(report(done.index, table))
    return reports


def run(
    store: Store,
    plan: Plan,
    executor: Executor,
    width: Callable[[], int],
    tell: Callable[[list[Report], bool], None] = lambda *_: None,
    lost: tuple[type[BaseException], ...] = (),
) -> None:
    """Train the shards that are not done yet. The lock must be held.

    Args:
        store: where the plan is; the executor must reach the same place under the same name.
        plan: as it is there.
        executor: what carries shards.
        width: how many shards it can work on now.
        tell: is given the shards that were done before, with True, and then each that has just been done, with False.
        lost: what a future of the executor raises whose worker died; its shard is done again, up to ATTEMPTS times.

    Raises:
        BrokenEnvironmentError, UsageError: a shard failed; those that were done stay.
    """
    reports = verified(store, plan)
    tell(reports, True)
    done = {report.index for report in reports}
    pending = _Pending(plan, (i for i in range(plan.n_shards) if i not in done))
    running: dict[Future[Report], int] = {}
    free: list[Program] = []
    died: tuple[type[BaseException], ...] = (WorkerDiedError, *lost)
    try:
        while pending or running:
            while pending and len(running) < width():
                index = pending.pop(free.pop() if free else None)
                running[executor.submit(work, store.url, index, plan.names[index])] = index
            if not running:
                time.sleep(TICK)  # nobody is there to work yet
            ended = concurrent.futures.wait(running, timeout=TICK, return_when=concurrent.futures.FIRST_COMPLETED).done
            for future in ended:
                index = running.pop(future)
                try:
                    tell([future.result()], False)
                    free.append(plan.firsts[index].program)
                except died as error:
                    pending.again(index, error)
    finally:
        for future in running:
            future.cancel()


class _Pending:
    """Shards to do. A worker goes on with the program that it has compiled; a new one gets one that none works on."""

    def __init__(self, plan: Plan, indices: Iterable[int]) -> None:
        self._plan = plan
        self._queues: dict[Program, collections.deque[int]] = {}
        self._taken: collections.Counter[Program] = collections.Counter()
        self._losses: collections.Counter[int] = collections.Counter()
        for index in indices:
            self.push(index)

    def __bool__(self) -> bool:
        return bool(self._queues)

    def push(self, index: int) -> None:
        """Add a shard behind those of its program."""
        self._queues.setdefault(self._plan.firsts[index].program, collections.deque()).append(index)

    def pop(self, compiled: Program | None) -> int:
        """Take the next shard for a worker that has compiled this program, or none."""
        if compiled not in self._queues:
            compiled = min(self._queues, key=lambda program: (self._taken[program], -len(self._queues[program])))
            self._taken[compiled] += 1
        waiting = self._queues[compiled]
        index = waiting.popleft()
        if not waiting:
            del self._queues[compiled]
        return index

    def again(self, index: int, error: BaseException) -> None:
        """Add a shard again whose worker died.

        Raises:
            UsageError: so many died with it that the shard itself must be the reason.
        """
        self._losses[index] += 1
        if isinstance(error, WorkerDiedError) or self._losses[index] >= ATTEMPTS:
            raise UsageError(
                f"shard {index} ended every worker that tried it; give fewer workers or a smaller shard_width if "
                "memory is short, and in a script start sweeps under "
                f'if __name__ == "__main__": ({error})'
            ) from error
        self.push(index)
