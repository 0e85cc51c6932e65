"""The options that the commands share, read from the command line with tyro."""

import contextlib
import dataclasses
import io
import re
import shlex
import sys
from collections.abc import Callable, Mapping, Sequence
from typing import Annotated, TypeVar, cast, get_args

import tyro
from tyro.constructors import (
    ConstructorRegistry,
    PrimitiveConstructorSpec,
    PrimitiveTypeInfo,
    StructConstructorSpec,
    StructFieldSpec,
    StructTypeInfo,
)

from galton.algorithms import ALGORITHMS, find_algorithm
from galton.cli._modules import search_here
from galton.envs.base import Environment
from galton.envs.find import find
from galton.envs.host.base import HostTask
from galton.envs.registry import ENVS, find_task, is_known, read_constants
from galton.errors import UsageError, require
from galton.losses import LOSSES
from galton.records import written
from galton.tasks import task_of
from galton.training.train import Result, check_arguments, train
from galton.types import Config, Hypers, Number

EnvName = Annotated[
    str,
    tyro.conf.Positional,
    tyro.conf.arg(
        metavar="ENV", help=f"one of {', '.join(ENVS)}, or a Gymnasium id (module:Id imports the module first)"
    ),
]
LossName = Annotated[str, tyro.conf.arg(metavar="{" + ",".join(LOSSES) + "}")]
LossNames = Annotated[tuple[str, ...], tyro.conf.arg(metavar="{" + ",".join(LOSSES) + "} ...")]

AlgorithmName = Annotated[str, tyro.conf.arg(metavar="{" + ",".join(ALGORITHMS) + "}")]

IN_CONFIG: Mapping[str, object] = {"loss": tyro.conf.Suppress, "algorithm": tyro.conf.Suppress}
"""What the command line makes of fields of Config, where not simply an option: each command names losses its own way,
and the algorithm, which decides on the other defaults, in an option of its own.

A value is anything that tyro takes in an `Annotated`.
"""


@dataclasses.dataclass(frozen=True)
class Training:
    """How long and with what to train; the defaults are the task's (App. C.2), or those of another algorithm."""

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
    def of_task(cls, name: str, algorithm: str = "a2c") -> "Training":
        """The defaults for the environment of that name: App. C.2's, except for what the algorithm usually has."""
        task, usual = task_of(name), find_algorithm(algorithm)
        fields = {**task.config, "learning_rate": task.learning_rate, **usual.defaults}
        numbers = {field: value for field, value in fields.items() if field in Hypers._fields}
        return cls(
            task.total_timesteps,
            task.n_logs,
            task.n_eval_episodes,
            config=usual.config(**{field: value for field, value in fields.items() if field not in numbers}),
            hypers=Hypers(**numbers),
        )

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
        self, env: Environment | HostTask, loss: str, seeds: Sequence[int], meanwhile: Callable[[int], None]
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
            meanwhile=meanwhile,
        )

    def find(self, name: str) -> Environment | HostTask:
        """The environment of a name that was typed, made with these keyword arguments."""
        if ":" in name:
            search_here()
        return find(name, **read_constants(self.env_kwargs))


def short_name(env: str) -> str:
    """The name of an environment in that of a folder: our own of the task, or the id without what a path can't hold."""
    return find_task(env)[0] if is_known(env) else re.sub(r"[^\w.-]+", "-", env)


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

    def read(training: Training) -> OptionsT:
        return tyro.cli(
            options,
            prog=f"galton {name}",
            args=list(arguments),
            default=options(env=tyro.MISSING, training=training),  # type: ignore[call-arg]
            config=(tyro.conf.OmitArgPrefixes,),
            registry=_REGISTRY,
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
    return read(Training.of_task(first.env, first.algorithm))  # type: ignore[attr-defined]


_REGISTRY = ConstructorRegistry()
"""How the records of galton.types, which know nothing of a command line, are read from one."""


@_REGISTRY.primitive_rule
def _one_number(info: PrimitiveTypeInfo) -> PrimitiveConstructorSpec[float] | None:
    """What may be one number or an array of them is one number here."""
    if {*get_args(info.type)} - {int} != {*get_args(Number)}:
        return None
    return PrimitiveConstructorSpec(
        nargs=1,
        metavar="FLOAT",
        instance_from_str=lambda words: float(words[0]),
        is_instance=lambda value: isinstance(value, int | float),
        str_from_instance=lambda value: [str(value)],
    )


class _AnyConfig(Config):
    """Config under another name, by which tyro's own rule for dataclasses can be asked."""


@_REGISTRY.struct_rule
def _config(info: StructTypeInfo) -> StructConstructorSpec | None:
    """Every field of Config is an option, spelt as IN_CONFIG has it."""
    if info.type is not Config:
        return None
    spec = ConstructorRegistry.get_struct_spec(dataclasses.replace(info, type=_AnyConfig))
    assert isinstance(spec, StructConstructorSpec)
    return StructConstructorSpec(Config, tuple(map(_spelt, spec.fields)))


def _spelt(field: StructFieldSpec) -> StructFieldSpec:
    if field.name not in IN_CONFIG:
        return field
    return dataclasses.replace(field, type=cast("type[object]", Annotated[field.type, IN_CONFIG[field.name]]))
