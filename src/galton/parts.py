"""Parts: the frozen records that an agent is made of, each of which owns its settings.

A part is a pytree. Its numbers and its own parts are leaves and branches, which `jax.vmap` can carry: a number may be
an array `[R]`, one for each of R runs. All else is part of its structure, for which programs are compiled.
"""

import abc
import dataclasses
import functools
from collections.abc import Sequence
from typing import (
    Annotated,
    Any,
    ClassVar,
    NamedTuple,
    TypeVar,
    cast,
    dataclass_transform,
    get_args,
    get_origin,
    no_type_check,
)

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from galton.errors import require
from galton.fields import Within, annotations, cached, checked

PartT = TypeVar("PartT", bound="Part")
_COMPUTED = (jax.core.Tracer, jax.ShapeDtypeStruct)
"""The types of the arrays that programs compute with, whose values can't be checked."""


Bounds = Float[np.ndarray, " d"] | Sequence[float]


class Box(NamedTuple):
    """The bounds of actions, d of each. Some of the d entries may be choices beside the numbers."""

    low: tuple[float, ...]
    high: tuple[float, ...]
    n_values: tuple[int, ...] = ()
    """The number of values of each entry that is a choice, which are low, low + 1, …; 0 for a number. () where all are
    numbers."""
    n_mask: int = 0
    """The entries of the masks that come with observations, as their last ones; 0: there are none."""
    names: tuple[str, ...] = ()
    """The name of each entry: its keys in the space and its place there, with dots between; () where these are 0, 1, …
    """

    @classmethod
    def of(cls, low: Bounds, high: Bounds, n_values: Sequence[int] = ()) -> "Box":
        """The box with these bounds."""
        return cls(tuple(map(float, low)), tuple(map(float, high)), tuple(n_values) if any(n_values) else ())

    @property
    def choices(self) -> tuple[int, ...]:
        """The places of the entries that are choices."""
        return tuple(i for i, n in enumerate(self.n_values) if n)

    @property
    def numbers(self) -> tuple[int, ...]:
        """The places of the entries that are numbers."""
        return tuple(i for i in range(len(self.low)) if i not in self.choices)

    @property
    def mask_sizes(self) -> tuple[int, ...]:
        """The entries of a mask for each entry of the action: one for each value of a choice.

        A number has none, or one for each of its bins.
        """
        n_values = self.n_values or (0,) * len(self.low)
        bins = (self.n_mask - sum(n_values)) // max(len(self.numbers), 1) if self.n_mask else 0
        return tuple(n or bins for n in n_values)

    @property
    def told(self) -> tuple[str, ...]:
        """The name of each entry."""
        return self.names or tuple(map(str, range(len(self.low))))

    def called(self, name: str) -> tuple[int, ...]:
        """The places of the entries of that name, or of a part of the space that has it; or of that place."""
        found = tuple(i for i, own in enumerate(self.told) if own == name or own.startswith(f"{name}."))
        return found or tuple(i for i in range(len(self.low)) if str(i) == name)

    def only(self, places: Sequence[int]) -> "Box":
        """The box of these entries alone."""
        low, high = (tuple(bound[i] for i in places) for bound in self[:2])
        return Box.of(low, high, tuple(self.n_values[i] for i in places) if self.n_values else ())

    def arrays(self) -> tuple[Float[np.ndarray, " d"], Float[np.ndarray, " d"]]:
        """Both bounds, in JAX's usual precision."""
        dtype = jax.dtypes.canonicalize_dtype(np.float64)
        return np.array(self.low, dtype), np.array(self.high, dtype)


@dataclass_transform(frozen_default=True)
class Part:
    """A frozen record of settings; a class of this kind is made a dataclass and a pytree.

    The annotation of a field is its check (`galton.fields`) and says what it is: a number with bounds is a leaf. One
    that may be None is absent from programs where every run has its default (see `trimmed`).

    Raises:
        UsageError: a field is not what its annotation says.
    """

    label: ClassVar[str] = ""
    """Its name in figures and tables."""
    fixed: ClassVar[tuple[str, ...]] = ()
    """Its numbers that no schedule may change."""

    def __init_subclass__(cls, **options: Any) -> None:
        super().__init_subclass__(**options)
        dataclasses.dataclass(frozen=True)(cls)
        no_type_check(cls.__init__)  # its fields are checked by `checked`, whose errors users read
        jax.tree_util.register_pytree_with_keys(cls, _flatten_with_keys, functools.partial(_unflatten, cls), _flatten)

    def __post_init__(self) -> None:
        for name, annotation in annotations(type(self)).items():
            if _is_part(annotation):
                checked(name, getattr(self, name), annotation)
        for name, annotation in settings(type(self)).items():
            value = getattr(self, name)
            if isinstance(value, Schedule) and is_number(annotation):
                require(name not in self.fixed, f"{name} is {value!r}; give one number, for it is a schedule's own")
                for each in value.values():
                    checked(f"a number of {name}", each, annotation)
            elif not isinstance(value, _COMPUTED):
                kept = checked(name, value, annotation)
                if is_number(annotation) and isinstance(kept, int | np.integer):
                    kept = float(kept)
                elif is_number(annotation) and isinstance(kept, list | tuple):
                    kept = np.asarray(kept, np.float32)
                elif is_number(annotation) and isinstance(kept, jax.Array):
                    kept = np.asarray(kept)[()]
                object.__setattr__(self, name, kept)
        if not any(isinstance(leaf, _COMPUTED) for leaf in jax.tree.leaves(self)):
            with jax.ensure_compile_time_eval():  # inside of a program as well
                for each in [self] if isinstance(self, Schedule) else _ends(self):
                    each.check_own()

    def check_own(self) -> None:
        """Raise UsageError for fields that don't go together."""

    def replace(self: PartT, **fields: Any) -> PartT:
        """The same part with other fields."""
        return cast("PartT", dataclasses.replace(cast("Any", self), **fields))


@cached
def settings(part: type[Part]) -> dict[str, Any]:
    """The settings that a kind of part owns, each with its annotation."""
    told, names = annotations(part), [field.name for field in dataclasses.fields(cast("Any", part))]
    return {name: told[name] for name in names if not _is_part(told[name]) and told[name] != Box | None}


def is_number(annotation: Any) -> bool:
    """Say whether an annotation is that of a number with bounds, which is a leaf."""
    return get_origin(annotation) is Annotated and isinstance(get_args(annotation)[1], Within)


def unusual(value: Any, usual: Any) -> str:
    """The first of a setting's values, one for each run, that is not the usual one, as it is told; empty for none."""
    if isinstance(usual, tuple) or usual is None or isinstance(value, Part):
        return "" if value == usual else str(value)
    given = np.atleast_1d(usual if value is None else value)
    others = given[given != (given.dtype.type(usual) if given.dtype == np.float32 else usual)][:1]
    return "".join(repr(str(other)) if isinstance(other, str) else str(other) for other in others)


def trimmed(part: PartT) -> PartT:
    """The part with None for each number that may be None and is the default in every run; its own parts likewise.

    Its program then has no trace of them.
    """
    told, changed = annotations(type(part)), dict[str, Any]()
    for name, annotation in told.items():
        value = getattr(part, name, None)
        if isinstance(value, Part):
            changed[name] = trimmed(value)
        elif is_number(annotation) and type(None) in get_args(get_args(annotation)[0]):
            changed[name] = value if np.any(value != getattr(type(part), name)) else None
    return part.replace(**changed) if changed else part


def _is_part(annotation: Any) -> bool:
    return isinstance(annotation, type) and issubclass(annotation, Part)


@cached
def _fields(part: type[Part]) -> tuple[tuple[str, ...], tuple[str, ...]]:
    """The fields of a part that are leaves or branches, and those that are its structure."""
    told, names = annotations(part), [field.name for field in dataclasses.fields(cast("Any", part))]
    inside = tuple(name for name in names if is_number(told[name]) or _is_part(told[name]))
    return inside, tuple(name for name in names if name not in inside)


def _flatten(part: Part) -> tuple[tuple[Any, ...], tuple[Any, ...]]:
    inside, structure = _fields(type(part))
    return tuple(getattr(part, name) for name in inside), tuple(getattr(part, name) for name in structure)


def _flatten_with_keys(part: Part) -> tuple[tuple[tuple[Any, Any], ...], tuple[Any, ...]]:
    children, structure = _flatten(part)
    return tuple(zip(map(jax.tree_util.GetAttrKey, _fields(type(part))[0]), children, strict=True)), structure


def _unflatten(cls: type[PartT], structure: tuple[Any, ...], children: tuple[Any, ...]) -> PartT:
    part = object.__new__(cls)
    inside, outside = _fields(cls)
    vars(part).update(zip((*inside, *outside), (*children, *structure), strict=True))
    return part


class Schedule(Part, abc.ABC):
    """A number that changes with the environment steps of a run (`galton.schedules`)."""

    @abc.abstractmethod
    def __call__(self, step: Float[Array, ""] | float) -> Float[Array, "*runs"]:
        """The number at this step."""

    @abc.abstractmethod
    def values(self) -> tuple[Any, ...]:
        """The numbers between which it stays, to be checked as the number that it stands for."""

    @property
    def is_endless(self) -> bool:
        """True if it goes over all that is trained, which nobody knows before."""
        return False

    def over(self: PartT, begin: int, end: float) -> PartT:
        """The same schedule where all that is trained goes from one step to another."""
        return self


def has_schedules(part: Part) -> bool:
    """Say whether one of a part's numbers is a schedule, or one of those of its own parts."""
    inside = (value for value in vars(part).values() if isinstance(value, Part))
    return any(isinstance(value, Schedule) or has_schedules(value) for value in inside)


def _ends(part: PartT) -> list[PartT]:
    """The part with each schedule at the first of the numbers between which it stays, at the second, and so on."""
    if not has_schedules(part):
        return [part]
    leaves, structure = jax.tree.flatten(part, is_leaf=lambda leaf: isinstance(leaf, Schedule))
    numbers = [leaf.values() if isinstance(leaf, Schedule) else (leaf,) for leaf in leaves]
    longest = max(map(len, numbers))
    rows = zip(*(each + each[-1:] * (longest - len(each)) for each in numbers), strict=True)
    return [jax.tree.unflatten(structure, row) for row in rows]


def at(part: PartT, step: Float[Array, "*runs"] | float) -> PartT:
    """The part with its schedules' numbers at a step; itself where it has none."""
    if not has_schedules(part):
        return part
    step = jnp.asarray(step, jnp.float32)

    def resolved(leaf: Any) -> Any:
        return leaf(step) if isinstance(leaf, Schedule) else leaf

    now: PartT = jax.tree.map(resolved, part, is_leaf=lambda leaf: isinstance(leaf, Schedule))
    return now
