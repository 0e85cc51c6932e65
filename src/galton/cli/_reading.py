"""How a command line becomes a record of options: tyro, and what Galton spells otherwise."""

import contextlib
import dataclasses
import io
import re
import sys
from collections.abc import Sequence
from decimal import Decimal, InvalidOperation
from types import NoneType, UnionType
from typing import Annotated, TypeVar, Union, cast, get_args, get_origin

import tyro
from tyro.constructors import (
    ConstructorRegistry,
    PrimitiveConstructorSpec,
    PrimitiveTypeInfo,
    StructConstructorSpec,
    StructFieldSpec,
    StructTypeInfo,
)

from galton.cli._words import options_of
from galton.errors import UsageError, did_you_mean
from galton.types import Number

OptionsT = TypeVar("OptionsT")

REGISTRY = ConstructorRegistry()
"""How types are read from words and shown in the help of a command."""


def read_options(
    options: type[OptionsT], name: str, arguments: Sequence[str], default: OptionsT | None = None
) -> OptionsT:
    """The options of the command of that name, from its arguments; `--help` is printed, and ends the process.

    Raises:
        UsageError: what can't be read, in one sentence.
    """
    said = io.StringIO()
    try:
        with contextlib.redirect_stderr(said):
            found, unknown = tyro.cli(
                options,
                prog=f"galton {name}",
                args=list(arguments),
                default=default,
                config=(tyro.conf.OmitArgPrefixes,),
                return_unknown_args=True,
                registry=REGISTRY,
            )
    except SystemExit as exit_:
        if not exit_.code:
            raise
        cause = exit_.__context__
        while cause and not isinstance(cause, UsageError):
            cause = cause.__context__
        odd = [word for word in arguments if word.startswith("--") and not _is_known(word, options)]
        told = _stray(odd[0], options, name) if odd else _in_a_line(said.getvalue(), name)
        raise cause or UsageError(told) from None
    sys.stderr.write(said.getvalue())
    if unknown:
        raise UsageError(_stray(unknown[0], options, name))
    assert found is not None
    return found


def _is_known(word: str, options: type) -> bool:
    """Whether a word is an option, or the opposite of one."""
    typed = word.partition("=")[0].replace("_", "-")
    return {typed, typed.replace("--no-", "--", 1)} & {*options_of(options).values(), "--help", "--"} != set()


def _stray(word: str, options: type, name: str) -> str:
    """What to say of a word that is no option and has no place."""
    help_ = f"`galton {name} --help` lists the options"
    if word.lower() in ("true", "false", "0", "1", "yes", "no"):
        return f"{word!r} is one argument too many; a switch stands alone, as --resume or --no-resume; {help_}"
    if not word.startswith("-"):
        return f"{word!r} is one argument too many; {help_}"
    typed, known = word.partition("=")[0], options_of(options)
    exact = known.get(typed.strip("-").replace("-", "_"), "")  # what functions call it
    if exact and not exact.startswith("--"):
        return f"{typed} is no option of `galton {name}`; its value has a place of its own, without a name; {help_}"
    meant = f"; did you mean {exact}?" if exact else did_you_mean(typed, known.values())
    return f"{typed} is no option of `galton {name}`{meant or f'; {help_}'}"


def _in_a_line(box: str, name: str) -> str:
    """The first part of a box that tyro drew, where it says what is wrong."""
    first = re.split(r"─{3,}", re.sub(r"\A.*\n", "", box))[0]
    told = " ".join(word for word in first.split() if word not in ("│", "(required)"))
    return f"{told.removeprefix('Error parsing ').rstrip('.')}; `galton {name} --help` lists the options"


def integer(text: str) -> int:
    """An integer as people write it: 100000, 100_000 or 1e5; ValueError for anything else."""
    try:
        number = Decimal(text)
        if number.is_finite() and abs(number.adjusted()) < 30 and number == int(number):
            return int(number)
    except InvalidOperation:
        pass
    raise ValueError(f"{text!r} is no integer; write it like 100000, 100_000 or 1e5")


@REGISTRY.primitive_rule
def _integer(info: PrimitiveTypeInfo) -> PrimitiveConstructorSpec[int] | None:
    if info.type is not int:
        return None
    return PrimitiveConstructorSpec(
        nargs=1,
        metavar="INT",
        instance_from_str=lambda words: integer(words[0]),
        is_instance=lambda value: isinstance(value, int),
        str_from_instance=lambda value: [str(value)],
    )


@REGISTRY.primitive_rule
def _integers(info: PrimitiveTypeInfo) -> PrimitiveConstructorSpec[tuple[int, ...]] | None:
    """Several integers stand apart by spaces; the message of the one that is none is what is told."""
    kind, *rest = get_args(info.type) or (None,)
    if get_origin(info.type) is not tuple or rest != [...] or (getattr(kind, "__origin__", kind) is not int):
        return None
    return PrimitiveConstructorSpec(
        nargs="*",
        metavar="[INT [INT ...]]",
        instance_from_str=lambda words: tuple(map(integer, words)),
        is_instance=lambda value: isinstance(value, tuple),
        str_from_instance=lambda value: [str(entry) for entry in value],
    )


@REGISTRY.primitive_rule
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


@REGISTRY.primitive_rule
def _what_may_be_left_out(info: PrimitiveTypeInfo) -> PrimitiveConstructorSpec[object] | None:
    """None can't be typed: it is what an option is that was not given."""
    kinds = [kind for kind in get_args(info.type) if kind is not NoneType]
    if get_origin(info.type) not in (Union, UnionType) or len(kinds) != 1:
        return None
    spec = ConstructorRegistry.get_primitive_spec(PrimitiveTypeInfo.make(kinds[0], info.markers))
    assert isinstance(spec, PrimitiveConstructorSpec)
    return dataclasses.replace(
        spec,
        is_instance=lambda value: value is None or spec.is_instance(value),
        str_from_instance=lambda value: ["None"] if value is None else spec.str_from_instance(value),
    )


_asked: set[object] = set()


@REGISTRY.struct_rule
def _record(info: StructTypeInfo) -> StructConstructorSpec | None:
    """Records are read as tyro reads them; only what the help says of a field is put plainly."""
    if info.type in _asked:
        return None  # so that tyro's own rules are the next
    _asked.add(info.type)
    try:
        spec = ConstructorRegistry.get_struct_spec(info)
    finally:
        _asked.discard(info.type)
    if not isinstance(spec, StructConstructorSpec):
        return None
    return dataclasses.replace(spec, fields=tuple(map(_plain, spec.fields)))


def _plain(field: StructFieldSpec) -> StructFieldSpec:
    """The field with its docstring as one paragraph, and with its default only where there is something to say."""

    def told() -> str | None:
        text = field.helptext() if callable(field.helptext) else field.helptext
        return text and " ".join(text.split())

    hint = tyro.conf.arg(help_behavior_hint=_default)
    return dataclasses.replace(field, type=cast("type[object]", Annotated[field.type, hint]), helptext=told)


def _default(label: str) -> str:
    return "" if label in ("None", "()", "") else f"(default: {label})"
