"""How a command that trains is parsed: its defaults are the task's, and its help has groups."""

import dataclasses
import functools
from collections.abc import Callable, Sequence
from typing import Annotated, Any, TypeVar

import tyro
from tyro.constructors import ConstructorRegistry, StructConstructorSpec, StructFieldSpec, StructTypeInfo

from galton.algorithms import ALGORITHMS, Algorithm
from galton.cli._options import Training
from galton.cli._reading import read_options
from galton.cli._registry import REGISTRY
from galton.cli._words import Without
from galton.errors import UsageError
from galton.parts import settings
from galton.policies import POLICIES
from galton.presets import PAPER, Preset, find_preset
from galton.types import Config, Hypers

OptionsT = TypeVar("OptionsT")

ELSEWHERE = ("loss", "algorithm")
"""The fields of Config that each command has as options of its own."""

TrainingOptions = Annotated[Training, tyro.conf.arg(name=""), Without(*ELSEWHERE)]
"""Training among the options of a command, whose help names its groups."""

GROUPS: dict[str, tuple[str, ...]] = {
    "training": ("steps", "n_envs", "logs", "eval_episodes", "env_kwargs"),
    "learning": (
        *("learning_rate", "decay_steps", "n_steps", "gamma", "gae_lambda", "ent_coef", "vf_coef", "max_grad_norm"),
        *("normalize_observation", "normalize_reward", "normalize_advantage", "weighting", "temperature"),
        *("entropy_target", "entropy_start", "entropy_end", "entropy_steps", "entropy_rate", "entropy_alpha_min"),
    ),
    **{name: tuple(own) for name, kind in ALGORITHMS.items() if (own := [*settings(kind)][len(settings(Algorithm)) :])},
    "policy": ("net_arch", "n_bins", "eta", "eta_rule", "eta_min", "eta_max", "negative_target"),
}
"""In which order help shows the options of Training. Those that no group has are the last of the policy's."""

TOLD = {"training": "The defaults are the task's (App. C.2), the preset's or the algorithm's; name ENV to see them."}
"""What help says of a group of options."""

_UNTOLD = 2**31 - 1
"""A number of environments that nobody types."""
_POLICIES = tyro.conf.arg(metavar="{" + ",".join(["auto", *POLICIES]) + "}")


def parse(
    options: type[OptionsT],
    name: str,
    arguments: Sequence[str],
    prepare: Callable[[OptionsT], None] = lambda _: None,
    preset: Preset | None = None,
    eval_episodes: int = 0,
) -> OptionsT:
    """Parse twice: the first time for the task, the algorithm and the preset, whose settings are the second's defaults.

    Between the two, `prepare` may register the task. A preset that is given here is taken whatever was typed, and
    an evaluation has at least so many episodes, unless it is typed how many.
    """

    def usual(training: Training, asked: Sequence[str], **others: str) -> OptionsT:
        return read_options(options, name, asked, options(env=tyro.MISSING, training=training, **others))  # type: ignore[call-arg]

    untold = Training(config=Config(n_envs=_UNTOLD))
    try:
        first = usual(untold, [word for word in arguments if word not in ("-h", "--help")])
    except UsageError:
        first = usual(Training(), arguments)  # help is printed even so
    prepare(first)
    env, algorithm, loss = first.env, first.algorithm, getattr(first, "loss", None)  # type: ignore[attr-defined]
    preset = preset or find_preset(getattr(first, "preset", PAPER) or None, loss or None, algorithm)
    others = {} if loss is None else {"loss": preset.loss, "preset": preset.name}
    n_envs = first.training.config.n_envs  # type: ignore[attr-defined]
    training = Training.of_task(env, algorithm, preset, None if n_envs == _UNTOLD else n_envs)
    least = dataclasses.replace(training, eval_episodes=max(training.eval_episodes, eval_episodes))
    return usual(least, arguments, **others)


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
