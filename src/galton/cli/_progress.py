"""Tables and the progress of training on a terminal."""

import contextlib
from collections.abc import Callable, Iterator

from rich.console import Console
from rich.progress import BarColumn, Progress, ProgressColumn, Task, TextColumn, TimeRemainingColumn
from rich.text import Text

from galton.cli._interrupts import deferred

Show = Callable[[int], None]
"""The function that is called with the steps so far, about twice a second."""

Follow = Callable[[str, int, int], Show]
"""(title, steps per run, runs) → what `train` calls meanwhile."""


def plain_console() -> Console:
    """A console that prints what it is given, letter by letter: a path may hold what rich takes for markup."""
    return Console(markup=False, emoji=False, highlight=False)


STOPPING = "interrupted; stopping after this update (once more: at once)"


@contextlib.contextmanager
def live_progress(console: Console, at_first: Callable[[], None] | None = None) -> Iterator[Follow]:
    """A line per task: done, speed, time left; an interrupt calls `at_first` and is raised between two updates."""
    columns = (
        TextColumn("{task.description:<24}", markup=False),
        BarColumn(),
        TextColumn("{task.percentage:>3.0f}%"),
        _Rate(),
        TimeRemainingColumn(elapsed_when_finished=True),
    )
    with deferred(STOPPING, at_first) as check, Progress(*columns, console=console) as progress:

        def follow(title: str, steps: int, runs: int) -> Show:
            task = progress.add_task(title, total=steps * runs)

            def show(step: int) -> None:
                check()
                progress.update(task, completed=step * runs)

            return show

        yield follow


class _Rate(ProgressColumn):
    """Steps per second since the first log point."""

    def render(self, task: Task) -> Text:
        """The rate; "compiling" before the first log point."""
        return Text(f"{task.speed:,.0f} steps/s" if task.speed else "compiling" if not task.finished else "")
