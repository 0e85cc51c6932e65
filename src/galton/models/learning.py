"""The loop behind `learn`: updates, log points, callbacks."""

import contextlib
import functools
import math
import threading
import time
import warnings
from collections.abc import Callable, Iterator
from typing import Any

import numpy as np

from galton import sb3
from galton.agents import words_of
from galton.algorithms import Rollout
from galton.callbacks import Print
from galton.errors import WideGaussian, require_integer
from galton.models.base import Base
from galton.models.calls import Calls, next_call
from galton.optimizers import Optimizer
from galton.parts import Schedule, at
from galton.training.log import Log
from galton.training.remedy import outgrown
from galton.training.run import over_all
from galton.training.train import Pieces, check_length


def updates_for(total_timesteps: object, rollout: Rollout, step: int) -> int:
    """The whole updates in which so many steps are taken; UsageError unless one run can, from this step on."""
    if isinstance(total_timesteps, float | np.floating) and total_timesteps.is_integer():
        total_timesteps = int(total_timesteps)
    require_integer("total_timesteps", total_timesteps, 1)
    assert isinstance(total_timesteps, int | np.integer)
    size = rollout.size
    n_updates = -(-int(total_timesteps) // size)
    check_length(int(total_timesteps), step // size + n_updates)
    if total_timesteps < size:
        warnings.warn(
            f"total_timesteps is {total_timesteps:,}, but an update takes n_steps · n_envs = {rollout.n_steps:,} · "
            f"{rollout.n_envs:,} = {size:,} steps, so {size:,} are taken; a smaller n_steps makes updates shorter",
            stacklevel=3,
        )
    return n_updates


def learn(
    model: Base,
    n_updates: int,
    callback: object,
    progress_bar: bool,
    printed: bool,
    decay_from: int | None,
) -> None:
    """Train for so many updates with callbacks of SB3's and ours; UsageError for one that can't be called."""
    first, size, start = model.num_timesteps, model.agent.rollout.size, time.perf_counter()
    last, log_interval = first + n_updates * size, model.log_interval
    begin = first if decay_from is None else decay_from
    optimizer = over_all(model.agent, begin, last).optimizer
    _tell_of_no_rate(optimizer, first, last, size)
    theirs, ours = _sorted_out(model, callback, printed, first, last)
    with compiling(printed):
        model.population.compile()
    pieces, told, going, step = Pieces(model.advance), False, True, first
    title = str(words_of(model.agent)["loss"])
    with _decaying(model, begin, last), _progress(progress_bar, title, last - first) as show:
        theirs.start()
        while going and step < last:
            stop = min(last, *(next_call(step, every, size) for every in (log_interval, *ours.intervals)))
            pieces.train(1 if theirs else (stop - step) // size)
            step, seconds = model.num_timesteps, time.perf_counter() - start
            going = theirs.after_update() and ours.meanwhile(seconds)
            if step == stop or not going:
                is_log_point = step % log_interval == 0
                is_told = is_log_point or step == last or not going
                log = named(model.population.log(begin_next=is_log_point), step, seconds, first)
                log["train/learning_rate"] = _rate(optimizer, step)
                log = theirs.recorded(is_told) | log
                most_clipped = log["train/edge_share"] > 0.5 and not told
                if most_clipped and (message := outgrown(at(model.agent, step), model.learner)):
                    warnings.warn(f"at step {step:,} {message}", WideGaussian, stacklevel=3)
                    told = True
                going = ours.after(step, size, log, is_told) and going
                step = model.num_timesteps  # which a callback may have trained
            show(step - first)
        theirs.end()
        ours.end()


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


def _rate(optimizer: Optimizer, step: int) -> float:
    """The learning rate of the update that ends at this step, as it is in float32."""
    return float(np.float32(at(optimizer, step).learning_rate) * optimizer.remaining(float(step)))


def _tell_of_no_rate(optimizer: Optimizer, first: int, last: int, size: int) -> None:
    """Warn where updates up to the last step learn nothing, but for the last of a decay, as in SB3."""
    given, decay_steps = optimizer.learning_rate, optimizer.decay_steps
    if isinstance(given, Schedule):
        if _rate(optimizer, first + size) or _rate(optimizer, max(first + size, last - size)):
            return
        told = f"learning_rate is {given!r}, 0 from step {first:,} to {last:,}, so nothing is learnt"
    elif np.float32(given) == 0:
        told = f"learning_rate is {given}, 0 in float32, so nothing is learnt; make the model with a greater one"
    elif _rate(optimizer, last - size) == 0 or _rate(optimizer, size) == 0:
        told = (
            f"decay_steps is {decay_steps:,.0f}, and the learning rate is 0 from there on, so nothing more is "
            f"learnt up to step {last:,}; make the model with decay_steps of all the steps that you train for"
        )
    else:
        return
    warnings.warn(told, stacklevel=4)


def _sorted_out(model: Base, callback: object, printed: bool, first: int, last: int) -> tuple[sb3.Callbacks, Calls]:
    """The callbacks that `learn` was given, SB3's and ours apart; UsageError for what can't be called."""
    given: list[Any] = [] if callback is None else [callback] if not isinstance(callback, list | tuple) else [*callback]
    given += [Print()] if printed else []
    theirs = [one for one in given if sb3.is_callback(one)]
    ours = [one for one in given if not sb3.is_callback(one)]
    return sb3.Callbacks(model, theirs, last), Calls(model, ours, first, last)


@contextlib.contextmanager
def _decaying(model: Base, begin: int, end: int) -> Iterator[None]:
    """A time in which what decays over all that is trained does so from one step to another; it has no end after it."""
    model.population.decay_over(begin, end)
    try:
        yield
    finally:
        model.population.decay_over(0, math.inf)


@contextlib.contextmanager
def compiling(printed: bool) -> Iterator[None]:
    """Say that programs are compiled inside, once that has taken a second.

    On a terminal it is said while it lasts; without one it is a line on standard error, if it is to be printed.
    """
    from rich.console import Console

    console = Console(stderr=True)
    status = console.status("compiling; what is compiled is kept, and found the next time")
    say: Callable[[], None] = status.start
    if not console.is_terminal:
        say = functools.partial(console.print, "compiling") if printed else lambda: None
    waiting = threading.Timer(1.0, say)
    waiting.start()
    try:
        yield
    finally:
        waiting.cancel()
        waiting.join()
        status.stop()


@contextlib.contextmanager
def _progress(shown: bool, title: str, total: int) -> Iterator[Callable[[int], None]]:
    """A bar that is told how many steps are done; none where it is not wanted, or can't be drawn."""
    if not shown:
        yield lambda _: None
        return
    from rich.console import Console
    from rich.progress import Progress

    console = Console()
    drawn = console.is_terminal or console.is_jupyter
    with Progress(console=console, transient=True, disable=not drawn) as progress:
        bar = progress.add_task(title, total=total)
        yield lambda done: progress.update(bar, completed=done)
