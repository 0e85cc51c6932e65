"""Rules make values of words, and say how the help of a command shows them: tyro's, and Galton's before them."""

import contextlib
import dataclasses
from collections.abc import Collection, Iterator
from contextvars import ContextVar
from decimal import Decimal, InvalidOperation
from types import NoneType, UnionType
from typing import Annotated, Union, cast, get_args, get_origin

import tyro
from tyro.constructors import (
    ConstructorRegistry,
    PrimitiveConstructorSpec,
    PrimitiveTypeInfo,
    StructConstructorSpec,
    StructFieldSpec,
    StructTypeInfo,
)

from galton.algorithms import ALGORITHMS
from galton.losses import LOSSES
from galton.presets import PRESETS
from galton.types import Number

REGISTRY = ConstructorRegistry()
"""The rules by which types are read from words and shown in the help of a command."""


def integer(text: str) -> int:
    """An integer as people write it: 100000, 100_000 or 1e5; ValueError for anything else."""
    with contextlib.suppress(InvalidOperation):
        number = Decimal(text)
        if number.is_finite() and abs(number.adjusted()) < 30 and number == int(number):
            return int(number)
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
def _one_number(info: PrimitiveTypeInfo) -> PrimitiveConstructorSpec[float | str] | None:
    """A setting that may be one number or an array of them is one number here."""
    if {*get_args(info.type)} - {int, NoneType} != {*get_args(Number)}:
        return None
    return PrimitiveConstructorSpec(
        nargs=1,
        metavar="FLOAT",
        instance_from_str=lambda words: words[0] if "(" in words[0] else float(words[0]),  # of a schedule
        is_instance=lambda value: isinstance(value, int | float | str),
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


_shown: ContextVar[Collection[str]] = ContextVar("shown", default=())


@contextlib.contextmanager
def showing(names: Collection[str]) -> Iterator[None]:
    """Leave all fields of records out but those of these names, if there are any: what a short help shows."""
    token = _shown.set(names)
    try:
        yield
    finally:
        _shown.reset(token)


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

    known = {"loss": [*LOSSES], "algorithm": [*ALGORITHMS], "preset": [*PRESETS]}.get(field.name)  # of imports too
    metavar = "{" + ",".join(known) + "}" if known else None
    marks = [tyro.conf.arg(help_behavior_hint=_default, metavar=metavar)]
    marks += [tyro.conf.Suppress] * bool(_shown.get() and field.name not in _shown.get())
    return dataclasses.replace(field, type=cast("type[object]", Annotated[field.type, *marks]), helptext=told)


def _default(label: str) -> str:
    return "" if label in ("None", "()", "", "''") else f"(default: {label})"
