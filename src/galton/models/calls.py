"""The callbacks of one call of `learn` are called as `galton.callbacks` says."""

import inspect
from collections.abc import Sequence
from typing import Any

import jax
import numpy as np

from galton.callbacks import Callback, Log
from galton.errors import UsageError, require, require_integer


class Calls:
    """Our callbacks of one call of `learn`; UsageError for one that can't be called, or would not be before the end."""

    def __init__(self, model: Any, callbacks: Sequence[object], first: int, last: int) -> None:
        self._model, self._callbacks = model, [_callable(one) for one in callbacks]
        for one in self._callbacks:
            _check_reached(one, first, last)
            if check := getattr(one, "check", None):
                check(model)

    @property
    def intervals(self) -> list[int]:
        """The steps between two calls of each callback that names them."""
        return [every for one in self._callbacks if (every := _every(one))]

    def meanwhile(self, seconds: float) -> bool:
        """Ask those that want to be asked between two updates whether to go on, so many seconds after the beginning."""
        asked: list[Any] = [one for one in self._callbacks if hasattr(one, "meanwhile")]
        verdicts = [one.meanwhile(self._model, seconds) for one in asked]
        return not any(map(_stops, verdicts))

    def after(self, step: int, size: int, log: Log, is_log_point: bool) -> bool:
        """Call those that are due after an update of that size, the last before this step; whether to go on."""
        going, n_names, waiting = True, len(log), []
        for one in self._callbacks:
            every = _every(one)
            due = step // every > (step - size) // every if every else is_log_point or not going or len(log) > n_names
            if due:
                going = not _stops(self._call(one, log)) and going
            elif not every:
                waiting.append(one)
        if not going:  # the end of `learn`, which is a log point for those too that came before the one that said so
            for one in waiting:
                self._call(one, log)
        return going

    def _call(self, one: Callback, log: Log) -> object:
        """Call one with the step of the model, which one before it may have trained."""
        log["time/total_timesteps"] = self._model.num_timesteps
        return one(self._model, log)

    def end(self) -> None:
        """Tell those that want to know that `learn` has ended."""
        for one in self._callbacks:
            if end := getattr(one, "end", None):
                end(self._model)


def next_call(step: int, every: int, size: int) -> int:
    """The end of the first update of that size, after this step, with which a multiple of `every` has been reached."""
    return -(-(step // every + 1) * every // size) * size


def _stops(verdict: object) -> bool:
    """True if a callback said to stop: by False, Python's or that of a comparison of NumPy's or JAX's."""
    of_jax = isinstance(verdict, jax.Array) and verdict.ndim == 0 and verdict.dtype == bool
    return (of_jax or isinstance(verdict, bool | np.bool)) and not verdict


def _every(callback: Callback) -> int | None:
    every: int | None = getattr(callback, "every", None)
    return every


def _callable(callback: object) -> Callback:
    """The callback, if it can be called with a model and a log."""
    if not callable(callback):
        raise UsageError(f"callback is {callback!r}; it must be callable as callback(model, log)")
    try:
        parameters = inspect.signature(callback)
    except (TypeError, ValueError):  # one written in C does not tell
        return callback
    of_sb3 = [name.strip("_") for name in parameters.parameters] == ["locals", "globals"]
    require(not of_sb3, f"callback is {callback!r} of locals and globals; Galton's take the model and the log")
    try:
        parameters.bind(None, None)
    except TypeError as error:
        message = f"callback is {callback!r}, which can't be called as callback(model, log): {error}"
        raise UsageError(message) from None
    return callback


def _check_reached(callback: Callback, first: int, last: int) -> None:
    every = _every(callback)
    if every is None:
        return
    name = getattr(callback, "__name__", type(callback).__name__)
    require_integer(f"every of {name}", every, 1)
    require(
        last // every > first // every,
        f"every of {name} is {every:,}, but learning from step {first:,} to {last:,} reaches no multiple of it, so it "
        f"would never be called; make it at most {last - first:,}, or learn for longer",
    )
