"""Callbacks are functions of the model and its log that `learn` calls while it trains; False stops training.

- One that has an attribute `every` is called whenever a multiple of that many steps of the run has been passed.
- Any other is called at log points: every `log_interval` updates, at the end of `learn`, and where a callback before
  it in the list has added to the log. So an evaluation goes before what writes the log down.
- One that has a method `meanwhile(model, seconds)`, seconds since `learn` began, is also asked about twice a second.
- One that has a method `check(model)` is asked when `learn` begins, and raises UsageError for what it can't do. One
  that has a method `end(model)` is told when `learn` has ended.
"""

import contextlib
import dataclasses
import itertools
import json
import math
import os
import secrets
import time
import warnings
import weakref
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from galton.agents import words_of, written
from galton.envs.find import find
from galton.envs.jax_task import JaxTask
from galton.envs.task import check_same_spaces
from galton.errors import is_number, require, require_integer
from galton.extras import needed
from galton.saving import files
from galton.saving.model_file import best_before
from galton.training.evaluate import Kept
from galton.training.yardsticks import Yardsticks

Log = dict[str, float]
Number = int | float | np.integer[Any] | np.floating[Any]
Callback = Callable[[Any, Log], bool | None]
"""(model, log) → whether to go on; None is yes."""


@dataclasses.dataclass
class Evaluate:
    """Play whole episodes without exploration; keep the best model.

    Adds `eval/mean_reward`, `eval/std_reward` and `eval/best_mean_reward` to the log. The first evaluation also plays
    three episodes of doing nothing and three of random actions, `eval/doing_nothing` and `eval/random_actions`, and
    you are warned where `learn` ends with a policy that is below one of them.
    """

    every: int = 10_000
    """Environment steps between evaluations, each rounded up to a whole update."""
    n_episodes: int = 10
    """The number of episodes that each evaluation plays."""
    env: object = None
    """The environment to play on; None for copies of the one that the model is trained on."""
    best_model: str | Path | None = None
    """The file to save the model in whenever its mean return is the highest so far. A run that is gone on with after
    `load` knows the best model that it kept there; a new run begins anew."""
    env_kwargs: Mapping[str, object] | None = None
    """Keyword arguments for an id or a name."""

    def __post_init__(self) -> None:
        require_integer("every", self.every, 1)
        require_integer("n_episodes", self.n_episodes, 1)
        require(self.env is not None or not self.env_kwargs, f"env_kwargs is {self.env_kwargs}; give env with it")
        self.best, self.latest = -math.inf, math.nan
        self.yardsticks: Yardsticks | None = None
        self._on: tuple[Any, Any] = (self.env, self.env_kwargs)
        self._run: object = None

    def check(self, model: Any) -> None:
        """Raise UsageError for an environment that can't be played on, or a file that can't be written."""
        self._let_go()
        run = (model.env_name, model.seed, words_of(model.agent))
        if not model.num_timesteps or self._run not in (None, run):  # another run begins anew
            self.best, self.latest, self.yardsticks = -math.inf, math.nan, None
        self._run = run
        if self.env is None:
            model.population.check_evaluation(self.n_episodes)
        else:
            task = find(self.env, **(self.env_kwargs or {}))
            check_same_spaces(task, model.actions, model.observations)
            self._on = (task if isinstance(task, JaxTask) else Kept(task, self.n_episodes), None)
        if self.best_model is not None:
            written(words_of(model.agent))
            path = Path(self.best_model)
            files.check_place("best_model", path)
            self.best = max(self.best, best_before(path, run, model.num_timesteps))

    def __call__(self, model: Any, log: Log) -> None:
        """Evaluate, and save the model if its mean return is the best so far."""
        returns = model.evaluate(self.n_episodes, *self._on)
        self.latest = mean = float(returns.mean())
        if self.yardsticks is None:
            self.yardsticks = model.yardsticks(*self._on)
            log |= self.yardsticks.log()
        if mean > self.best:
            self.best = mean
            if self.best_model is not None:
                model.take().scored(mean).save(self.best_model)
        log |= {
            "eval/mean_reward": mean,
            "eval/std_reward": float(returns.std()),
            "eval/best_mean_reward": self.best,
        }

    def end(self, _: Any) -> None:
        """Close the copies of the environment that were made to play on; warn of a policy that need not be learnt."""
        self._let_go()
        if self.yardsticks and (told := self.yardsticks.not_reached_by(self.latest)):
            warnings.warn(f"{told}; train for longer, or see what galton.check_env says of it", stacklevel=2)

    def _let_go(self) -> None:
        if isinstance(self._on[0], Kept):
            self._on[0].close()
        self._on = (self.env, self.env_kwargs)


@dataclasses.dataclass
class Checkpoint:
    """Save the model again and again while it is trained."""

    path: str | Path
    """A file, written over each time; `{step}` in its name keeps them all."""
    every: int = 100_000
    """Environment steps between saves, each rounded up to a whole update."""

    def __post_init__(self) -> None:
        require_integer("every", self.every, 1)
        unknown = str(self.path).replace("{step}", "")
        require("{" not in unknown, f"path is {self.path}; {{step}} is all that can stand in braces")

    def check(self, model: Any) -> None:
        """Raise UsageError for a file, or a model, that can't be written."""
        written(words_of(model.agent))
        path = Path(self.path)
        folders = itertools.takewhile(lambda part: "{step}" not in part, path.parent.parts)
        files.check_place("path", Path(*folders, path.name))

    def __call__(self, model: Any, _: Log) -> None:
        """Save the model, with its step where the path has `{step}`."""
        model.save(str(self.path).replace("{step}", str(model.num_timesteps)))


@dataclasses.dataclass
class StopOnReward:
    """Stop once a number in the log reaches a threshold."""

    threshold: Number
    """Training stops where the number is as high as this, or higher."""
    metric: str = "eval/mean_reward"
    """A key of the log; points without it are passed over, and you are warned if all were."""

    def __post_init__(self) -> None:
        require(is_number(self.threshold), f"threshold is {self.threshold!r}; it must be a number")
        require(not math.isnan(self.threshold), "threshold is nan, which no number reaches")
        self._known = False

    def __call__(self, _: Any, log: Log) -> bool:
        """Go on while the number is below the threshold or not in the log."""
        self._known |= self.metric in log
        return not log.get(self.metric, -math.inf) >= self.threshold

    def end(self, _: Any) -> None:
        """Warn if the number was never in the log."""
        if not self._known:
            told = f"metric is {self.metric}, which was in no log, so StopOnReward could not stop"
            warnings.warn(f"{told}; what adds it, such as Evaluate, goes before it in the list", stacklevel=2)


@dataclasses.dataclass
class StopAfter:
    """Stop after some time, counted from the beginning of `learn`, at the next whole update."""

    seconds: Number
    """The time that `learn` may take, in seconds."""

    def __post_init__(self) -> None:
        fits = is_number(self.seconds) and self.seconds > 0
        require(fits, f"seconds is {self.seconds!r}; it must be a number greater than 0")

    def __call__(self, model: Any, log: Log) -> bool:
        """Go on while there is time."""
        return self.meanwhile(model, log["time/time_elapsed"])

    def meanwhile(self, _: Any, seconds: float) -> bool:
        """Go on while there is time, after so many seconds."""
        return bool(seconds < self.seconds)


class Print:
    """Prints a line of numbers at each log point."""

    SHOWN = (
        *("rollout/ep_rew_mean", "rollout/ep_len_mean", "eval/mean_reward", "eval/doing_nothing"),
        *("eval/random_actions", "train/entropy", "time/fps"),
    )

    def __call__(self, model: Any, log: Log) -> None:
        """Print those of SHOWN that are known."""
        known = [name for name in self.SHOWN if math.isfinite(log.get(name, math.nan))]
        told = ", ".join(f"{name.split('/')[1]} {log[name]:,.6g}" for name in known)
        print(f"step {model.num_timesteps:,}: {told}", flush=True)


class JSONLines:
    """One line of JSON per log point, appended to a file; null where a number is not known."""

    def __init__(self, path: str | Path) -> None:
        self.path = Path(path)
        with files.named("path", self.path):
            self.path.parent.mkdir(parents=True, exist_ok=True)
            self.path.open("a").close()

    def __call__(self, _: Any, log: Log) -> None:
        """Append this log point to the file as a whole line, or raise UsageError and leave the file as it was."""
        known = {name: value if math.isfinite(value) else None for name, value in log.items()}
        with files.named("path", self.path):
            files.append_line(self.path, json.dumps(known, default=float))  # NumPy's numbers too


class TensorBoard:
    """Scalars for TensorBoard, under the names of Stable-Baselines3 where it has them."""

    def __init__(self, folder: str | Path) -> None:
        from tensorboardX.event_file_writer import EventsWriter

        # tensorboardX's SummaryWriter writes in a thread, where a full disk would end nothing but the thread.
        self.folder = folder
        with files.named("folder", folder):
            Path(folder).mkdir(parents=True, exist_ok=True)
            # Its names are of whole seconds: two of one folder would write one file.
            self._writer = EventsWriter(f"{folder}/events", f".{os.getpid()}-{secrets.token_hex(4)}")
        weakref.finalize(self, _close, self._writer)

    def __call__(self, model: Any, log: Log) -> None:
        """Write this log point's finite numbers as scalars of its step; UsageError where they can't be written."""
        from tensorboardX.proto.event_pb2 import Event
        from tensorboardX.summary import scalar

        with files.named("folder", self.folder):
            for name, value in log.items():
                if math.isfinite(value):
                    event = Event(summary=scalar(name, value), step=model.num_timesteps, wall_time=time.time())
                    self._writer.write_event(event)
            self._writer.flush()


def _close(writer: Any) -> None:
    """Close a file that nobody writes any more; what a full disk did not take has been told."""
    with contextlib.suppress(OSError, ValueError):
        writer.close()


class WeightsAndBiases:
    """Scalars for Weights & Biases; needs `pip install 'galton[wandb]'`.

    Args:
        settings: for `wandb.init`, such as project and name.
    """

    def __init__(self, **settings: object) -> None:
        with needed("WeightsAndBiases", "wandb"):
            import wandb
        self.run = wandb.init(**settings)

    def __call__(self, model: Any, log: Log) -> None:
        """Send this log point's finite numbers to the run."""
        self.run.log({name: value for name, value in log.items() if math.isfinite(value)}, step=model.num_timesteps)
