"""Plans that are carried out in view of whoever typed the command."""

import contextlib
import sys
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import Executor

from galton.cli._console import plain_console
from galton.cli._sweep_view import live
from galton.sweep import engine, executors
from galton.sweep.engine import CarryOut
from galton.sweep.executors import Place
from galton.sweep.plan import Plan
from galton.sweep.shard import finished
from galton.sweep.store import Store


@contextlib.contextmanager
def processes(places: Sequence[Place]) -> Iterator[CarryOut]:
    """A process in each place for a while: a function that has them carry out one plan after the other."""
    with executors.processes(places) as executor:
        yield lambda store, plan: carry(store, plan, executor, lambda: len(places))


def carry(
    store: Store,
    plan: Plan,
    executor: Executor,
    width: Callable[[], int],
    lost: tuple[type[BaseException], ...] = (),
) -> None:
    """Carry a plan out. Ctrl-C ends the command; what is done stays."""
    try:
        with live(plain_console(), plan) as view:
            engine.run(store, plan, executor, width, view, lost=lost)
    except KeyboardInterrupt:
        print(
            f"galton: interrupted; {len(finished(store, plan)):,} of {plan.n_shards:,} shards are done, and the same "
            "command goes on with the rest",
            file=sys.stderr,
        )
        sys.exit(130)
