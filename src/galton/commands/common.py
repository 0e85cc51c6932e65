"""What the commands share: options, progress, provenance."""

import contextlib
import dataclasses
import importlib.metadata
import io
import json
import platform
import re
import shlex
import signal
import sys
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Annotated, Any, TypeVar

import tyro
from rich.console import Console
from rich.progress import BarColumn, Progress, ProgressColumn, Task, TextColumn, TimeRemainingColumn
from rich.text import Text

from galton.envs.base import Environment, HostTask
from galton.envs.find import find
from galton.envs.registry import ENVS, find_task, is_known, read_constants
from galton.errors import UsageError
from galton.losses import LOSSES
from galton.tasks import task_of
from galton.training.state import Log
from galton.training.train import Result, check_arguments, train
from galton.types import Config, Hypers

OnLog = Callable[[int, Log | None], None]
"""What is called at each log point with the steps so far and the log."""

EnvName = Annotated[
    str,
    tyro.conf.Positional,
    tyro.conf.arg(
        metavar="ENV", help=f"one of {', '.join(ENVS)}, or a Gymnasium id (module:Id imports the module first)"
    ),
]
LossName = Annotated[str, tyro.conf.arg(metavar="{" + ",".join(LOSSES) + "}")]
LossNames = Annotated[tuple[str, ...], tyro.conf.arg(metavar="{" + ",".join(LOSSES) + "} ...")]


@dataclasses.dataclass(frozen=True)
class Training:
    """How long and with what to train; the defaults are the task's (App. C.2)."""

    steps: int = 500_000
    """Environment steps per run."""
    logs: int = 100
    """Points of a learning curve."""
    eval_episodes: int = 10
    """Episodes of the deterministic policy at each of them; 0 turns evaluation off."""
    env_kwargs: Annotated[str, tyro.conf.arg(metavar="JSON")] = "{}"
    """Keyword arguments of the environment, such as '{"noise_std": 0.5}'."""
    config: Config = dataclasses.field(default_factory=Config)
    hypers: Hypers = dataclasses.field(default_factory=Hypers)

    @classmethod
    def of_task(cls, name: str) -> "Training":
        """The defaults for a task."""
        task = task_of(name)
        return cls(
            task.total_timesteps,
            task.n_logs,
            task.n_eval_episodes,
            config=Config(**task.config),
            hypers=Hypers(learning_rate=task.learning_rate),
        )

    def record(self) -> dict[str, Any]:
        """All of it for JSON."""
        config = {name: value for name, value in dataclasses.asdict(self.config).items() if name != "loss"}
        given = {"env_kwargs": self.constants(), "config": config, "hypers": self.hypers._asdict()}
        return dataclasses.asdict(self) | given

    def check(self, seeds: Sequence[int]) -> None:
        """Raise UsageError for what `run` can't take, before anything is begun."""
        check_arguments(self.hypers, seeds, self.steps, self.logs, self.eval_episodes)

    def run(
        self, env: Environment | HostTask, loss: str, seeds: Sequence[int], on_log: Callable[[int, Log], None]
    ) -> Result:
        """Train."""
        return train(
            env,
            dataclasses.replace(self.config, loss=loss),
            self.hypers,
            seeds,
            self.steps,
            n_logs=self.logs,
            n_eval_episodes=self.eval_episodes,
            on_log=on_log,
        )

    def find(self, name: str) -> Environment | HostTask:
        """The environment of that name."""
        return find(name, **self.constants())

    def constants(self) -> dict[str, Any]:
        """env_kwargs as a dictionary."""
        return read_constants(self.env_kwargs)


def short_name(env: str) -> str:
    """For a folder: our own name of the task, or the id without what a path can't hold."""
    return find_task(env)[0] if is_known(env) else re.sub(r"[^\w.-]+", "-", env)


OptionsT = TypeVar("OptionsT")


def parse(
    options: type[OptionsT], name: str, arguments: Sequence[str], prepare: Callable[[OptionsT], None] = lambda _: None
) -> OptionsT:
    """Parse twice: the first time for the task, whose settings are the defaults of the second.

    Between the two, `prepare` may register the task.
    """

    def read(training: Training) -> OptionsT:
        return tyro.cli(
            options,
            prog=f"galton {name}",
            args=list(arguments),
            default=options(env=tyro.MISSING, training=training),  # type: ignore[call-arg]
            config=(tyro.conf.OmitArgPrefixes,),
        )

    try:
        with contextlib.redirect_stderr(io.StringIO()), contextlib.redirect_stdout(io.StringIO()):
            first = read(Training())
    except SystemExit as exit_:
        cause = exit_.__context__
        while cause:
            if isinstance(cause, UsageError):
                raise cause from None
            cause = cause.__context__
        first = read(Training())  # tyro explains itself, or prints its help
    prepare(first)
    return read(Training.of_task(first.env))  # type: ignore[attr-defined]


class _Rate(ProgressColumn):
    """Steps per second since the first log point."""

    def render(self, task: Task) -> Text:
        return Text(f"{task.speed:,.0f} steps/s" if task.speed else "compiling" if not task.finished else "")


Follow = Callable[[str, int, int], OnLog]
"""(title, steps per run, runs) → an on_log for `train`."""


@contextlib.contextmanager
def live_progress(console: Console) -> Iterator[Follow]:
    """A line per task: done, speed, time left. A Ctrl-C or SIGTERM meanwhile is raised at the next log point.

    Raised at once it would hit JAX in the middle of its compiler, which crashes or swallows it.
    """
    caught: list[int] = []

    def catch(number: int, _: object) -> None:
        if not caught:
            print("galton: interrupted; stopping at the next log point (once more: at once)", file=sys.stderr)
        signal.signal(number, signal.default_int_handler)
        caught.append(number)

    def follow(title: str, steps: int, runs: int) -> OnLog:
        task = progress.add_task(title, total=steps * runs)

        def on_log(step: int, _: Log | None) -> None:
            if caught:
                raise KeyboardInterrupt
            progress.update(task, completed=step * runs)

        return on_log

    columns = (
        TextColumn("{task.description:<24}"),
        BarColumn(),
        TextColumn("{task.percentage:>3.0f}%"),
        _Rate(),
        TimeRemainingColumn(elapsed_when_finished=True),
    )
    previous = {number: signal.signal(number, catch) for number in (signal.SIGINT, signal.SIGTERM)}
    try:
        with Progress(*columns, console=console) as progress:
            yield follow
        if caught:
            raise KeyboardInterrupt
    finally:
        for number, handler in previous.items():
            signal.signal(number, handler)


def write_settings(folder: Path, settings: dict[str, Any]) -> None:
    """config.json: the settings, the command, the versions and the machine."""
    versions = {name: importlib.metadata.version(name) for name in ("galton", "jax", "jaxlib", "optax", "numpy")}
    record = settings | {
        "command": shlex.join(["galton", *sys.argv[1:]]),
        "versions": versions | {"python": platform.python_version()},
        "machine": platform.platform(),
    }
    (folder / "config.json").write_text(json.dumps(record, indent=2, default=str) + "\n")
