"""What can happen at the log points of `A2C.learn`: functions of the model and its log; False stops training.

They are called in order and may add to the log, so an evaluation goes before what writes the log down.
"""

import contextlib
import dataclasses
import json
import math
import time
import weakref
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any, Protocol, runtime_checkable

import numpy as np

from galton.errors import UsageError, require, require_integer
from galton.saving import files

Log = dict[str, float]


@runtime_checkable
class Model(Protocol):
    """What a callback may use of an A2C; it may use all the rest of it too."""

    @property
    def num_timesteps(self) -> int:
        """Environment steps so far."""

    @property
    def log_interval(self) -> int:
        """Environment steps between log points."""

    def evaluate(self, n_episodes: int, env: object = None) -> np.ndarray:
        """Undiscounted returns of whole episodes without exploration."""

    def save(self, path: str | Path) -> Path:
        """Write the model to one file and return its path."""


Callback = Callable[[Any, Log], bool | None]
"""(model, log) → whether to go on; None is yes."""


def is_due(model: Model, every: int) -> bool:
    """Whether a multiple of `every` steps lies between the last log point and this one, itself included."""
    return model.num_timesteps // every > (model.num_timesteps - model.log_interval) // every


@dataclasses.dataclass
class Evaluate:
    """Play whole episodes without exploration; keep the best model.

    Adds `eval/mean_reward`, `eval/std_reward` and `eval/best_mean_reward` to the log.
    """

    every: int = 10_000
    """Environment steps between evaluations, rounded up to log points."""
    n_episodes: int = 10
    env: object = None
    """What to play on; None for copies of the environment that the model is trained on."""
    best_model: str | Path | None = None
    """Where to save the model each time that its mean return is the highest so far."""

    def __post_init__(self) -> None:
        require_integer("every", self.every, 1)
        require_integer("n_episodes", self.n_episodes, 1)
        self.best = -math.inf

    def __call__(self, model: Model, log: Log) -> None:
        """Evaluate if a multiple of `every` steps has been passed since the last log point."""
        if not is_due(model, self.every):
            return
        returns = model.evaluate(self.n_episodes, self.env)
        mean = float(returns.mean())
        if mean > self.best:
            self.best = mean
            if self.best_model is not None:
                model.save(self.best_model)
        log |= {
            "eval/mean_reward": mean,
            "eval/std_reward": float(returns.std()),
            "eval/best_mean_reward": self.best,
        }


@dataclasses.dataclass
class Checkpoint:
    """Save the model again and again while it is trained."""

    path: str | Path
    """A file, written over each time; `{step}` in its name keeps them all."""
    every: int = 100_000
    """Environment steps between saves, rounded up to log points."""

    def __post_init__(self) -> None:
        require_integer("every", self.every, 1)

    def __call__(self, model: Model, log: Log) -> None:
        """Save if a multiple of `every` steps has been passed since the last log point."""
        del log
        if is_due(model, self.every):
            model.save(str(self.path).replace("{step}", str(model.num_timesteps)))


@dataclasses.dataclass
class StopOnReward:
    """Stop once a number in the log reaches a threshold."""

    threshold: float
    metric: str = "eval/mean_reward"
    """A key of the log; points without it are passed over."""

    def __call__(self, model: Model, log: Log) -> bool:
        """Go on while the number is below the threshold or not in the log."""
        del model
        return not log.get(self.metric, -math.inf) >= self.threshold


@dataclasses.dataclass
class StopAfter:
    """Stop after some time, at the next log point."""

    seconds: float

    def __post_init__(self) -> None:
        require(self.seconds > 0, f"seconds is {self.seconds}; it must be greater than 0")

    def __call__(self, model: Model, log: Log) -> bool:
        """Go on while there is time, counted from the beginning of `learn`."""
        del model
        return log["time/time_elapsed"] < self.seconds


class JSONLines:
    """One line of JSON per log point, appended to a file; null where a number is not known."""

    def __init__(self, path: str | Path) -> None:
        self.path = Path(path)
        with _written(self.path):
            self.path.parent.mkdir(parents=True, exist_ok=True)
            self.path.open("a").close()

    def __call__(self, model: Model, log: Log) -> None:
        """Append this log point to the file as a whole line, or raise UsageError and leave the file as it was."""
        del model
        known = {name: value if math.isfinite(value) else None for name, value in log.items()}
        with _written(self.path):
            files.append_line(self.path, json.dumps(known))


class TensorBoard:
    """Scalars for TensorBoard, under the names of Stable-Baselines3 where it has them."""

    def __init__(self, folder: str | Path) -> None:
        from tensorboardX.event_file_writer import EventsWriter, directory_check

        # tensorboardX's SummaryWriter writes in a thread, where a full disk would end nothing but the thread.
        self.folder = folder
        with _written(folder):
            directory_check(str(folder))
            self._writer = EventsWriter(f"{folder}/events")
        weakref.finalize(self, _close, self._writer)

    def __call__(self, model: Model, log: Log) -> None:
        """Write this log point's finite numbers as scalars of its step; UsageError where they can't be written."""
        from tensorboardX.proto.event_pb2 import Event
        from tensorboardX.summary import scalar

        with _written(self.folder):
            for name, value in log.items():
                if math.isfinite(value):
                    event = Event(summary=scalar(name, value), step=model.num_timesteps, wall_time=time.time())
                    self._writer.write_event(event)
            self._writer.flush()


def _close(writer: Any) -> None:
    """Close a file that nobody writes any more; what a full disk did not take has been told."""
    with contextlib.suppress(OSError, ValueError):
        writer.close()


@contextlib.contextmanager
def _written(path: str | Path) -> Iterator[None]:
    """Turn the error of a file that can't be written into one that says what to do."""
    try:
        yield
    except OSError as error:
        raise UsageError(f"path is {path}, which can't be written: {error.strerror}; name another") from None


class WeightsAndBiases:
    """Scalars for Weights & Biases; needs `pip install 'galton[wandb]'`.

    Args:
        settings: for `wandb.init`, such as project and name.
    """

    def __init__(self, **settings: object) -> None:
        try:
            import wandb
        except ImportError:
            raise UsageError("WeightsAndBiases needs wandb: pip install 'galton[wandb]'") from None
        self.run = wandb.init(**settings)

    def __call__(self, model: Model, log: Log) -> None:
        """Send this log point's finite numbers to the run."""
        self.run.log({name: value for name, value in log.items() if math.isfinite(value)}, step=model.num_timesteps)
