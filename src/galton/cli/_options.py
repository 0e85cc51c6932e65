"""The options that the commands share, read from the command line with tyro."""

import dataclasses
import functools
import hashlib
import re
import shlex
import sys
from collections.abc import Callable, Sequence
from typing import Annotated, Any, TypeVar

import tyro
from tyro.constructors import ConstructorRegistry, StructConstructorSpec, StructFieldSpec, StructTypeInfo

from galton.algorithms import ALGORITHMS, find_algorithm
from galton.cli._reading import REGISTRY, read_options
from galton.cli._words import Fills
from galton.envs.base import Environment
from galton.envs.find import find
from galton.envs.host.base import HostTask
from galton.envs.registry import ENVS, find_task, is_known, read_constants
from galton.errors import UsageError, require
from galton.losses import LOSSES
from galton.models.settings import split
from galton.policies import POLICIES
from galton.records import written
from galton.tasks import task_of
from galton.training.log import Log
from galton.training.train import Result, check_arguments, train
from galton.types import Config, Hypers

EnvName = Annotated[
    str,
    tyro.conf.Positional,
    tyro.conf.arg(
        metavar="ENV", help=f"one of {', '.join(ENVS)}, or a Gymnasium id (module:Id imports the module first)"
    ),
]
_LOSSES, _ALGORITHMS = ("{" + ",".join(known) + "}" for known in (LOSSES, ALGORITHMS))
LossName = Annotated[str, tyro.conf.arg(metavar=_LOSSES, help="What is minimised: docs/paper.md has each of them.")]
LossNames = Annotated[
    tuple[str, ...], Fills("loss"), tyro.conf.arg(metavar=f"{_LOSSES} ...", help="The losses, each named once.")
]
AlgorithmName = Annotated[
    str, tyro.conf.arg(metavar=_ALGORITHMS, help="What learns; the defaults of its settings are its own.")
]

GROUPS: dict[str, tuple[str, ...]] = {
    "training": ("steps", "n_envs", "logs", "eval_episodes", "env_kwargs"),
    "learning": (
        *("learning_rate", "decay_steps", "n_steps", "gamma", "gae_lambda", "ent_coef", "vf_coef", "max_grad_norm"),
        *("normalize_observation", "normalize_reward", "normalize_advantage"),
    ),
    **{name: algorithm.own for name, algorithm in ALGORITHMS.items() if algorithm.own},
    "policy": ("net_arch", "n_bins", "eta"),
}
"""In which order help shows the options of Training. Those that no group has are the last of the policy's."""

TOLD = {"training": "The defaults are the task's (App. C.2), or those of another algorithm."}
"""What help says of a group of options."""

_POLICIES = tyro.conf.arg(metavar="{" + ",".join(["auto", *POLICIES]) + "}")

ELSEWHERE = ("loss", "algorithm")
"""The fields of Config that each command has as options of its own."""


@dataclasses.dataclass(frozen=True)
class Training:
    """How long and with what to train; the defaults are the task's (App. C.2), or those of another algorithm."""

    steps: Annotated[int, Fills("total_timesteps")] = 500_000
    """Environment steps per run."""
    logs: Annotated[int, Fills("n_logs")] = 100
    """Points of a learning curve."""
    eval_episodes: Annotated[int, Fills("n_eval_episodes")] = 10
    """Episodes of the deterministic policy at each of them; 0 turns evaluation off."""
    env_kwargs: Annotated[str, tyro.conf.arg(metavar="JSON")] = "{}"
    """Keyword arguments of the environment, such as '{"noise_std": 0.5}'."""
    config: Config = dataclasses.field(default_factory=Config)
    hypers: Hypers = dataclasses.field(default_factory=Hypers)

    @classmethod
    def of_task(cls, name: str, algorithm: str = "a2c") -> "Training":
        """The defaults for the environment of that name: App. C.2's, except for what the algorithm usually has."""
        task = task_of(name)
        config, hypers = split(find_algorithm(algorithm), Config.loss, Config.n_envs, {}, name)
        return cls(task.total_timesteps, task.n_logs, task.n_eval_episodes, config=config, hypers=hypers)

    def record(self) -> dict[str, object]:
        """These options for JSON; the losses are told apart from them."""
        config = {name: value for name, value in written(self.config).items() if name != "loss"}
        constants = read_constants(self.env_kwargs)
        return dataclasses.asdict(self) | {"env_kwargs": constants, "config": config, "hypers": written(self.hypers)}

    def check(self, seeds: Sequence[int]) -> None:
        """Raise UsageError for what `run` can't take, before anything is begun."""
        check_arguments(self.hypers, seeds, self.steps, self.logs, self.eval_episodes)
        require(self.steps < 2**31, f"total_timesteps is {self.steps}; one run counts up to 2³¹ − 1 steps")

    def run(
        self, env: Environment | HostTask, loss: str, seeds: Sequence[int], on_log: Callable[[int, Log], None]
    ) -> Result:
        """Train a run of this loss for each seed."""
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
        """The environment of that name, made with these keyword arguments."""
        return find(name, **read_constants(self.env_kwargs))


TrainingOptions = Annotated[Training, tyro.conf.arg(name="")]
"""Training among the options of a command, whose help names its groups."""

LONGEST = 100
"""Bytes of an id in the name of a folder; file systems end at 255, and what is beside the id needs some of them."""


def short_name(env: str) -> str:
    """The name of an environment in that of a folder: our own of the task, or the id without what a path can't hold."""
    if is_known(env):
        return find_task(env)[0]
    name = re.sub(r"[^\w.-]+", "-", env)
    if len(name.encode()) <= LONGEST:
        return name
    kept = name.encode()[:LONGEST].decode(errors="ignore")
    return f"{kept}-{hashlib.sha256(env.encode(errors='surrogateescape')).hexdigest()[:8]}"


def folder_name(env: str, algorithm: str) -> str:
    """The name of a run's folder: the environment's, with the algorithm's where that is not the paper's."""
    return short_name(env) if algorithm == "a2c" else f"{short_name(env)}-{algorithm}"


def command_line() -> str:
    """The command line as it was typed, for the record of a run."""
    return shlex.join(["galton", *sys.argv[1:]])


OptionsT = TypeVar("OptionsT")


def parse(
    options: type[OptionsT], name: str, arguments: Sequence[str], prepare: Callable[[OptionsT], None] = lambda _: None
) -> OptionsT:
    """Parse twice: the first time for the task and the algorithm, whose settings are the defaults of the second.

    Between the two, `prepare` may register the task.
    """

    def usual(training: Training, asked: Sequence[str]) -> OptionsT:
        return read_options(options, name, asked, options(env=tyro.MISSING, training=training))  # type: ignore[call-arg]

    try:
        first = usual(Training(), [word for word in arguments if word not in ("-h", "--help")])
    except UsageError:
        first = usual(Training(), arguments)  # help is printed even so
    prepare(first)
    return usual(Training.of_task(first.env, first.algorithm), arguments)  # type: ignore[attr-defined]


@REGISTRY.struct_rule
def _training(info: StructTypeInfo) -> StructConstructorSpec | None:
    """Training is shown as GROUPS has it, and not as it lies in its records."""
    if info.type is not Training or not isinstance(info.default, Training):
        return None
    default, fields = info.default, _fields_of(info)
    grouped = {field for group in GROUPS.values() for field in group}
    groups = GROUPS | {"policy": (*GROUPS["policy"], *(name for name in fields if name not in grouped))}
    records = []
    for title, names in groups.items():
        group = _group(title, [fields[name] for name in names])
        records.append(StructFieldSpec(title, group, tyro.MISSING_NONPROP, TOLD.get(title, "")))
    return StructConstructorSpec(functools.partial(_filled, default), tuple(records))


def _fields_of(info: StructTypeInfo) -> dict[str, StructFieldSpec]:
    """Every option of Training and of the records in it."""
    found: dict[str, StructFieldSpec] = {}
    for kind, default in ((_AnyTraining, info.default), (Config, info.default.config), (Hypers, info.default.hypers)):
        spec = ConstructorRegistry.get_struct_spec(dataclasses.replace(info, type=kind, default=default))
        assert isinstance(spec, StructConstructorSpec)
        found |= {field.name: field for field in spec.fields}
    policy: Any = Annotated[found["policy"].type, _POLICIES]
    found["policy"] = dataclasses.replace(found["policy"], type=policy)
    return {name: field for name, field in found.items() if name not in ("config", "hypers", *ELSEWHERE)}


class _AnyTraining(Training):
    """Training under another name, by which the rule for all records can be asked."""


def _group(title: str, fields: Sequence[StructFieldSpec]) -> type:
    """A record with these fields."""
    members = [
        (field.name, field.type, dataclasses.field(default=field.default, metadata={"help": _help_of(field)}))
        for field in fields
    ]
    return dataclasses.make_dataclass(title, members)


def _help_of(field: StructFieldSpec) -> str | None:
    return field.helptext() if callable(field.helptext) else field.helptext


def _filled(default: Training, **groups: Any) -> Training:
    """The training with what the groups hold."""
    given: dict[str, Any] = {name: value for group in groups.values() for name, value in vars(group).items()}
    config = {field.name: given.pop(field.name) for field in dataclasses.fields(Config) if field.name in given}
    hypers = {name: given.pop(name) for name in Hypers._fields if name in given}
    given["config"] = dataclasses.replace(default.config, **config)
    return dataclasses.replace(default, **given, hypers=default.hypers._replace(**hypers))
