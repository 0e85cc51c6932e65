"""The options that the commands share, read from the command line with tyro."""

import dataclasses
import hashlib
import re
import shlex
import sys
from collections.abc import Sequence
from typing import Annotated

import tyro

from galton.agents import in_two, written
from galton.algorithms import find_algorithm
from galton.cli._reading import search_here
from galton.cli._words import Fills
from galton.envs.find import find
from galton.envs.registry import ENVS, key_of, read_constants
from galton.envs.task import Task
from galton.models.settings import all_words
from galton.parts import settings
from galton.presets import PAPER, Preset
from galton.records import Fields
from galton.tasks import task_of
from galton.training.train import check_arguments, check_length
from galton.words import values_of, vocabulary

EnvName = Annotated[
    str,
    tyro.conf.Positional,
    tyro.conf.arg(
        metavar="ENV",
        help=f"one of {', '.join(ENVS)}, or a Gymnasium id (module:Id imports the module first), or module:Class",
    ),
]
LossName = Annotated[str, tyro.conf.arg(help="What is minimised: docs/losses.md has each of them.")]
AlgorithmName = Annotated[
    str, tyro.conf.arg(help="The algorithm that learns; the defaults of its settings are its own.")
]
PresetName = Annotated[
    str,
    tyro.conf.arg(
        help="What the other defaults are: a well-set Gaussian's, those that our benchmark selected for "
        "classification, or the paper's; by default paper where --loss is given, and else classification for A2C "
        "and gaussian for the others.",
    ),
]


@dataclasses.dataclass(frozen=True)
class Training:
    """Length and settings of training; the defaults are the task's (App. C.2), the preset's or the algorithm's."""

    steps: Annotated[int, Fills("total_timesteps")] = 500_000
    """Environment steps per run."""
    logs: Annotated[int, Fills("n_logs")] = 100
    """Points of a learning curve."""
    eval_episodes: Annotated[int, Fills("n_eval_episodes")] = 10
    """Episodes of the deterministic policy at each point of the curve; 0 turns evaluation off."""
    env_kwargs: Annotated[str, tyro.conf.arg(metavar="JSON")] = "{}"
    """Keyword arguments of the environment, such as '{"noise_std": 0.5}'."""
    words: Fields = dataclasses.field(default_factory=lambda: dict(vocabulary().usual))
    """The settings of the agent's parts, each an option of its own."""

    @classmethod
    def of_task(
        cls,
        name: str,
        algorithm: str = "a2c",
        preset: Preset = Preset(PAPER),  # noqa: B008
        n_envs: int | None = None,
        batch_size: int | None = None,
    ) -> "Training":
        """The defaults for the environment of that name: App. C.2's, the preset's and the algorithm's."""
        task, chosen = task_of(name), find_algorithm(algorithm)
        own = {} if batch_size is None or "batch_size" not in settings(chosen) else {"batch_size": batch_size}
        words = all_words(chosen, preset, n_envs, own, name)
        return cls(task.total_timesteps, task.n_logs, task.n_eval_episodes, words=vocabulary().usual | words)

    def record(self) -> dict[str, object]:
        """These options for JSON; the losses are told apart from them."""
        own = {field.name: getattr(self, field.name) for field in dataclasses.fields(self) if field.name != "words"}
        words = {name: value for name, value in written(self.words).items() if name != "loss"}
        return own | {"env_kwargs": read_constants(self.env_kwargs)} | in_two(words)

    def check(self, seeds: Sequence[int]) -> None:
        """Raise UsageError for what `train` can't take, before anything is begun."""
        values_of(self.words)
        check_arguments(seeds, self.steps, self.logs, self.eval_episodes)
        check_length(self.steps, self.steps // (self.words["n_steps"] * self.words["n_envs"]))

    def find(self, name: str) -> Task:
        """The environment of a name that was typed, made with these keyword arguments."""
        if ":" in name:
            search_here()
        return find(name, **read_constants(self.env_kwargs))


LONGEST, SHORTER = 100, 40
"""Bytes of an id, and of another name, in that of a folder; file systems end at 255, and locks need some of them."""


DEVICES = re.compile(r"^(con|prn|aux|nul|com\d|lpt\d)(?=\.|$)", re.IGNORECASE)
"""The beginning of a name that Windows keeps for devices."""


def short_name(env: str) -> str:
    """The name of an environment in that of a folder: our own of the task, or the id without what a path can't hold."""
    return plain_name(key_of(env), LONGEST)


def plain_name(name: str, longest: int = SHORTER) -> str:
    """A name from a registry or an id as a part of a folder's, on any system: without what a path can't hold."""
    plain = DEVICES.sub(r"\1-", re.sub(r"[^\w.-]+", "-", name)).rstrip(".")
    if len(plain.encode()) <= longest:
        return plain
    kept = plain.encode()[:longest].decode(errors="ignore")
    return f"{kept}-{hashlib.sha256(name.encode(errors='surrogatepass')).hexdigest()[:8]}"


def folder_name(env: str, algorithm: str) -> str:
    """The name of a run's folder: the environment's, with the algorithm's where that is not the paper's."""
    return short_name(env) if algorithm == "a2c" else f"{short_name(env)}-{plain_name(algorithm)}"


def command_line() -> str:
    """The command line as it was typed, for the record of a run."""
    return shlex.join(["galton", *sys.argv[1:]])
