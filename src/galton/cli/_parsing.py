"""Commands that train are parsed here: their defaults are the task's, and their help has groups."""

import argparse
import dataclasses
import functools
from collections.abc import Collection, Iterable, Sequence
from typing import Annotated, Any, TypeVar

import tyro
from tyro.constructors import ConstructorRegistry, StructConstructorSpec, StructFieldSpec, StructTypeInfo

from galton.algorithms import Rollout
from galton.cli._options import Training
from galton.cli._reading import import_typed, read_options
from galton.cli._registry import REGISTRY
from galton.cli._words import ELSEWHERE
from galton.errors import UsageError
from galton.parts import Part, settings
from galton.presets import PAPER, Preset, find_preset
from galton.words import CHOICES, Choice, refuse_idle, vocabulary, without_idle

OptionsT = TypeVar("OptionsT")

COMMON = (
    *("env", "loss", "losses", "preset", "algorithm", "seed", "seeds", "out", "overwrite", "resume", "training"),
    *("steps", "eval_episodes", "n_envs", "learning_rate", "gamma", "save_every", "tensorboard"),
)
"""These options of a command are shown by `--help`, and the rest too by `--help-all`."""

TrainingOptions = Annotated[Training, tyro.conf.arg(name="")]
"""Training among the options of a command, whose help names its groups."""

TOLD = {"training": "The defaults are the task's (App. C.2), the preset's or the algorithm's; name ENV to see them."}
"""The help text of a group of options, by the group's name."""

_FOR_DEFAULTS = ("n_envs", "batch_size")
"""The settings on which the defaults of others depend."""
_UNTOLD = 2**31 - 1
"""A number that nobody types for them."""


def parse(
    options: type[OptionsT],
    name: str,
    arguments: Sequence[str],
    preset: Preset | None = None,
    eval_episodes: int = 0,
    common: Collection[str] = (),
) -> OptionsT:
    """Parse twice: the first time for the task, the algorithm and the preset, whose settings are the second's defaults.

    Modules that are typed are imported before, for what they register has options too. A preset that is given here is
    taken whatever was typed, and an evaluation has at least so many episodes, unless it is typed how many. A short help
    shows the `common` options.
    """
    import_typed(_imports(arguments))

    def usual(training: Training, asked: Sequence[str], **others: str) -> OptionsT:
        default = options(env=tyro.MISSING, training=training, **others)  # type: ignore[call-arg]
        return read_options(options, name, asked, default, common)

    untold = Training(words=vocabulary().usual | dict.fromkeys(_FOR_DEFAULTS, _UNTOLD))
    try:
        first = usual(untold, [word for word in arguments if word not in ("-h", "--help", "--help-all")])
    except UsageError:
        first = usual(Training(), arguments)  # help is printed even so
    env, algorithm, loss = first.env, first.algorithm, getattr(first, "loss", None)  # type: ignore[attr-defined]
    preset = preset or find_preset(getattr(first, "preset", PAPER) or None, loss or None, algorithm)
    others = {} if loss is None else {"loss": preset.loss, "preset": preset.name}
    words = first.training.words  # type: ignore[attr-defined]
    typed = (words[name] if words.get(name, _UNTOLD) != _UNTOLD else None for name in _FOR_DEFAULTS)
    training = Training.of_task(env, algorithm, preset, *typed)
    least = dataclasses.replace(training, eval_episodes=max(training.eval_episodes, eval_episodes))
    found = usual(least, arguments, **others)
    if loss == "":  # who names none may think that it is another one
        words = found.training.words  # type: ignore[attr-defined]
        refuse_idle(words | others, {name for name in words if words[name] != least.words.get(name)})
    return found


def _imports(arguments: Sequence[str]) -> list[str]:
    parser = argparse.ArgumentParser(add_help=False, allow_abbrev=False)
    parser.add_argument("--imports", nargs="*", default=[])
    return list(parser.parse_known_args(arguments)[0].imports)


@REGISTRY.struct_rule
def _training(info: StructTypeInfo) -> StructConstructorSpec | None:
    """Training is shown as a group of its own options, and one for the settings of each part of an agent."""
    if info.type is not Training or not isinstance(info.default, Training):
        return None
    own = _group("training", [(f.name, f.type, f.default, _help_of(f)) for f in _fields(_AnyTraining, info)])
    groups = {"training": own} | _of_parts(info)
    records = [StructFieldSpec(name, kind, tyro.MISSING_NONPROP, TOLD.get(name, "")) for name, kind in groups.items()]
    return StructConstructorSpec(functools.partial(_filled, info.default), tuple(records))


class _AnyTraining(Training):
    """Training under another name, by which the rule for all records can be asked."""


def _fields(kind: type, info: StructTypeInfo) -> list[StructFieldSpec]:
    """The fields that tyro makes of a record's, but for a mapping of settings."""
    default = info.default if kind is _AnyTraining else tyro.MISSING_NONPROP
    spec = ConstructorRegistry.get_struct_spec(dataclasses.replace(info, type=kind, default=default))
    assert isinstance(spec, StructConstructorSpec)
    return [field for field in spec.fields if field.name != "words"]


def _of_parts(info: StructTypeInfo) -> dict[str, type]:
    """A group for each part of an agent: the word that chooses it, and the settings that no earlier one has."""
    known, usual, shown = vocabulary(), info.default.words, {*ELSEWHERE}
    groups: dict[str, type] = {}
    registries: dict[str, Collection[type[Part]]] = {"rollout": [Rollout]}
    registries |= {part: choice.registry.values() for part, choice in CHOICES.items()}
    for part, kinds in registries.items():
        members: list[tuple[str, Any, Any, str | None]] = []
        if part in CHOICES and (word := CHOICES[part].word) not in shown:
            members.append((word, _kind(CHOICES[part]), usual[word], CHOICES[part].meaning))
        told = {field.name: _help_of(field) for kind in kinds for field in _fields(kind, info)}
        names = dict.fromkeys(name for kind in kinds for name in settings(kind) if name not in shown)
        members += [(name, known.annotations[name], usual[name], told[name]) for name in names]
        shown |= {*names}
        if members:
            groups[part] = _group(part, members)
    return groups


def _kind(choice: Choice) -> Any:
    """The type of what may be typed for a word that chooses a part."""
    names = ["auto", *choice.registry] if choice.usual == "auto" else [*choice.registry]
    return bool if True in choice.registry else Annotated[str, tyro.conf.arg(metavar="{" + ",".join(names) + "}")]


def _group(title: str, fields: Iterable[tuple[str, Any, Any, str | None]]) -> type:
    """A record with these fields: name, type, default and help."""
    members = [
        (name, kind, dataclasses.field(default=default, metadata={"help": told}))
        for name, kind, default, told in fields
    ]
    return dataclasses.make_dataclass(title, members)


def _help_of(field: StructFieldSpec) -> str | None:
    return field.helptext() if callable(field.helptext) else field.helptext


def _filled(default: Training, training: Any, **parts: Any) -> Training:
    words = {name: value for part in parts.values() for name, value in vars(part).items()}
    return dataclasses.replace(default, **vars(training), words=without_idle(default.words | words, default.words))
