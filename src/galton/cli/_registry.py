"""How words become values: tyro's rules, and Galton's before them."""

import contextlib
from decimal import Decimal, InvalidOperation
from types import NoneType
from typing import get_args, get_origin

from tyro.constructors import ConstructorRegistry, PrimitiveConstructorSpec, PrimitiveTypeInfo

from galton.types import Number

REGISTRY = ConstructorRegistry()
"""How types are read from words."""


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
    """What may be one number or an array of them is one number here."""
    if {*get_args(info.type)} - {int, NoneType} != {*get_args(Number)}:
        return None
    return PrimitiveConstructorSpec(
        nargs=1,
        metavar="FLOAT",
        instance_from_str=lambda words: _number(words[0]),
        is_instance=lambda value: isinstance(value, int | float | str),
        str_from_instance=lambda value: [str(value)],
    )


def _number(text: str) -> float | str:
    """A number, or the words of a schedule, which `agents.read` checks."""
    return text if "(" in text else float(text)
