"""The progress of training on a terminal, and what Ctrl-C means meanwhile."""

import contextlib
import signal
import sys
from collections.abc import Callable, Iterator

from rich.console import Console
from rich.progress import BarColumn, Progress, ProgressColumn, Task, TextColumn, TimeRemainingColumn
from rich.text import Text

from galton.training.log import Log

OnLog = Callable[[int, Log | None], None]
"""What is called at each log point with the steps so far and the log."""

Follow = Callable[[str, int, int], OnLog]
"""(title, steps per run, runs) → an on_log for `train`."""


@contextlib.contextmanager
def live_progress(console: Console) -> Iterator[Follow]:
    """A line per task: done, speed, time left. A Ctrl-C or SIGTERM meanwhile is raised at the next log point."""
    columns = (
        TextColumn("{task.description:<24}"),
        BarColumn(),
        TextColumn("{task.percentage:>3.0f}%"),
        _Rate(),
        TimeRemainingColumn(elapsed_when_finished=True),
    )
    with _interrupts_deferred() as check, Progress(*columns, console=console) as progress:

        def follow(title: str, steps: int, runs: int) -> OnLog:
            task = progress.add_task(title, total=steps * runs)

            def on_log(step: int, _: Log | None) -> None:
                check()
                progress.update(task, completed=step * runs)

            return on_log

        yield follow


@contextlib.contextmanager
def _interrupts_deferred() -> Iterator[Callable[[], None]]:
    """A function that raises KeyboardInterrupt if the user asked to stop since; the end of the block calls it too.

    An interrupt that is raised at once hits JAX in the middle of its compiler, which crashes or swallows it. So only
    a second one is.
    """
    caught: list[int] = []

    def catch(number: int, _: object) -> None:
        if not caught:
            print("galton: interrupted; stopping at the next log point (once more: at once)", file=sys.stderr)
        signal.signal(number, signal.default_int_handler)
        caught.append(number)

    def check() -> None:
        if caught:
            raise KeyboardInterrupt

    previous = {number: signal.signal(number, catch) for number in (signal.SIGINT, signal.SIGTERM)}
    try:
        yield check
        check()
    finally:
        for number, handler in previous.items():
            signal.signal(number, handler)


class _Rate(ProgressColumn):
    """Steps per second since the first log point."""

    def render(self, task: Task) -> Text:
        """The rate; "compiling" before the first log point."""
        return Text(f"{task.speed:,.0f} steps/s" if task.speed else "compiling" if not task.finished else "")
