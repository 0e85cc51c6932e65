"""The loop behind `learn`: updates, log points, callbacks."""

import contextlib
import time
from collections.abc import Callable, Iterator
from typing import Any, Protocol, runtime_checkable

from galton import sb3
from galton.algorithms import Agent
from galton.callbacks import Callback
from galton.errors import DivergenceError, require
from galton.training.log import Log
from galton.training.population import Population
from galton.training.remedy import remedy
from galton.types import Config


@runtime_checkable
class Learning(Protocol):
    """What the training loop needs of a model."""

    config: Config

    @property
    def num_timesteps(self) -> int:
        """How many environment steps the run has taken, all copies together."""

    @property
    def updates_per_log(self) -> int:
        """How many updates lie between two log points."""

    @property
    def population(self) -> Population:
        """The one run, as training sees it."""

    def advance(self, n_updates: int) -> None:
        """Train for so many updates, without callbacks or a log."""


def learn(model: Learning, n_updates: int, callback: object, progress_bar: bool) -> None:
    """Train for so many updates, with a log point every `model.updates_per_log`.

    Callbacks of SB3's are called after each update, ours at log points, until one says to stop.
    """
    first, interval = model.num_timesteps, model.updates_per_log
    size = model.config.n_steps * model.config.n_envs
    last, done = first + n_updates * size, first // size
    theirs, ours = _sorted_out(model, callback, n_updates * size)
    start = time.perf_counter()
    with _progress(progress_bar, model.config.loss, n_updates * size) as show:
        going = theirs.start()
        while going and model.num_timesteps < last:
            to_log = interval - done % interval
            n = min(to_log, (last - model.num_timesteps) // size, 1 if theirs else to_log)
            model.advance(n)
            done += n
            going = theirs.after_update()
            if n == to_log:
                log = named(model.population.log(), model.num_timesteps, time.perf_counter() - start, first)
                verdicts = [one(model, log) for one in ours]
                going = going and all(verdict is not False for verdict in verdicts)
            show(model.num_timesteps - first)
        theirs.end()


def check_divergence(agent: Agent, population: Population) -> None:
    """Raise DivergenceError once the run's gradient was not finite."""
    step = int(population.diverged_at[0])
    if step >= 0:
        raise DivergenceError(
            f"the gradient was not finite at step {step:,}; the model keeps the parameters before it. "
            f"{remedy(agent, population.learner)}"
        )


def named(log: Log, step: int, seconds: float, first: int) -> dict[str, float]:
    """The log under SB3's names, where it has one; `first` is the step where the clock started."""
    columns = {name: float(value[0]) for name, value in log.columns().items()}
    return {
        "rollout/ep_rew_mean": columns.pop("training_return"),
        "rollout/ep_len_mean": columns.pop("episode_length"),
        "rollout/n_episodes": columns.pop("n_episodes"),
        "time/total_timesteps": step,
        "time/time_elapsed": seconds,
        "time/fps": (step - first) / seconds,
    } | {f"train/{name}": value for name, value in columns.items() if name != "evaluation_return"}


def _sorted_out(model: Learning, callback: object, total_timesteps: int) -> tuple[sb3.Callbacks, list[Callback]]:
    """The callbacks that `learn` was given, SB3's and ours apart; UsageError for what can't be called."""
    given: list[Any] = [] if callback is None else [callback] if not isinstance(callback, list | tuple) else [*callback]
    ours = [one for one in given if not sb3.is_callback(one)]
    for one in ours:
        require(callable(one), f"callback is {one!r}; it must be callable as callback(model, log)")
    return sb3.Callbacks(model, [one for one in given if sb3.is_callback(one)], total_timesteps), ours


@contextlib.contextmanager
def _progress(shown: bool, title: str, total: int) -> Iterator[Callable[[int], None]]:
    """A bar that is told how many steps are done; none where it is not wanted."""
    if not shown:
        yield lambda _: None
        return
    from rich.progress import Progress

    with Progress(transient=True) as progress:
        bar = progress.add_task(title, total=total)
        yield lambda done: progress.update(bar, completed=done)
