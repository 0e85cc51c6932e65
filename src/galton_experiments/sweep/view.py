"""Plans that are carried out in view of whoever asked for them: progress, speed, and the best settings so far."""

import contextlib
import time
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import Executor

import numpy as np
from rich.console import Console, Group
from rich.live import Live
from rich.progress_bar import ProgressBar
from rich.table import Table

from galton.decimals import fitting
from galton.losses import find_loss
from galton_experiments.sweep import engine, executors
from galton_experiments.sweep.engine import CarryOut
from galton_experiments.sweep.executors import Place
from galton_experiments.sweep.plan import Plan
from galton_experiments.sweep.shard import Report, finished
from galton_experiments.sweep.store import Store


class View:
    """A view shows how far a sweep is, and is drawn again whenever rich asks for it."""

    def __init__(self, plan: Plan) -> None:
        self._plan, self._start = plan, time.monotonic()
        self._runs = self._steps = 0
        self._steps_before = self._runs_before = 0
        self._returns: dict[int, list[float]] = {}

    def tell(self, reports: list[Report], before: bool) -> None:
        """Count shards that are done; those that were done before have no part in speed and time left."""
        for report in reports:
            self._runs += len(report.setting)
            self._steps += report.steps
            for setting, value in zip(report.setting, report.final_training_return, strict=True):
                self._returns.setdefault(setting, []).append(value)
        if before:
            self._runs_before, self._steps_before = self._runs, self._steps

    def __rich__(self) -> Group:
        """Draw progress, speed, time left, and the best setting of each loss so far."""
        bar = ProgressBar(total=self._plan.n_runs, completed=self._runs, width=60)
        return Group(self.line(), bar, self._best())

    def line(self) -> str:
        """Say progress, speed and time left in one line."""
        line, runs = f"{self._runs:,} of {self._plan.n_runs:,} runs", self._runs - self._runs_before
        if not runs:
            return line
        elapsed = time.monotonic() - self._start
        speed, left = (self._steps - self._steps_before) / elapsed, (self._plan.n_runs - self._runs) / runs * elapsed
        return f"{line}, {speed:,.0f} env-steps/s, {_duration(left)} left"

    def _best(self) -> Table:
        table = Table("loss", "best setting so far", "final training return", "runs", box=None)
        best: dict[str, tuple[float, float, int, int]] = {}
        for i, values in list(self._returns.items()):  # the sweep adds to it from another thread
            loss, lost = self._plan.study.settings[i]["loss"], np.isnan(values)
            mean = -np.inf if lost.all() else float(np.nanmean(values))
            this = (-float(lost.mean()), mean, len(values), i)
            best[loss] = this if loss not in best else max(best[loss], this, key=lambda each: each[:2])
        for loss, (_, mean, n, i) in sorted(best.items()):
            brief = self._plan.study.settings[i].brief(self._plan.study.varied)
            table.add_row(find_loss(loss).label, brief, f"{mean:{fitting(mean)}}", str(n))
        return table


@contextlib.contextmanager
def workers(places: Sequence[Place] | None = None) -> Iterator[CarryOut]:
    """Processes for a while, by default one per core: a function that has them train one plan after the other.

    `sweep(study, out, workers=…)` takes it, so that many studies share the processes and what they have compiled.
    """
    places = executors.one_per_core() if places is None else places
    with executors.processes(places) as executor:
        yield lambda store, plan: carry(store, plan, executor, lambda: len(places))


def carry(
    store: Store,
    plan: Plan,
    executor: Executor,
    width: Callable[[], int],
    lost: tuple[type[BaseException], ...] = (),
) -> None:
    """Carry a plan out as `engine.run` does, and show how far it is: on a terminal all the time, else at the end.

    Raises:
        KeyboardInterrupt: Ctrl-C; it says how many shards are done, which stay.
    """
    console, view = Console(markup=False, emoji=False, highlight=False), View(plan)
    drawn = Live(view, console=console, refresh_per_second=2) if console.is_terminal else contextlib.nullcontext()
    try:
        with drawn:
            engine.run(store, plan, executor, width, view.tell, lost)
    except KeyboardInterrupt:
        done = len(finished(store, plan))
        raise KeyboardInterrupt(f"{done:,} of {plan.n_shards:,} shards are done") from None
    if not console.is_terminal:
        console.print(view.line())


def _duration(seconds: float) -> str:
    minutes, hours = int(seconds // 60), int(seconds // 3600)
    return f"{hours} h {minutes % 60} min" if hours else f"{minutes} min {int(seconds % 60)} s"
