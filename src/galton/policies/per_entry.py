"""Settings that single entries of an action have for themselves, as words: "wheel.n_bins=9" or "n_bins=[5, 9]"."""

import ast
from collections.abc import Mapping, Sequence
from typing import Annotated, Any, Literal, NamedTuple

import numpy as np

from galton.bins import Bins, PlacedBins, mu_law
from galton.errors import UsageError, require
from galton.fields import AtLeast, checked
from galton.parts import Box
from galton.types import Positive

Centers = Literal["inside", "bounds", "mu-law"]
Start = Literal["uniform", "gaussian", "clipped-gaussian"]
EVERY = "*"
"""The name that all numbers have together."""


class Entry(NamedTuple):
    """The settings that a number in an action has, its own or the policy's."""

    n_bins: int
    bin_centers: Centers | tuple[float, ...]
    """A word, or the centers themselves."""
    initial_policy: str = "uniform"
    eta: float | None = None
    """HL-Gauss's width; None: the loss's."""

    def bins(self, low: float, high: float) -> Bins:
        """The bins of a number between these bounds."""
        if isinstance(self.bin_centers, tuple):
            return PlacedBins(low, high, self.bin_centers)
        if self.bin_centers == "mu-law":
            return PlacedBins(low, high, mu_law(low, high, self.n_bins))
        return Bins(low, high, self.n_bins, self.bin_centers)


def read(word: str) -> tuple[str, str, Any]:
    """The entry, the setting and its value there that a word says; UsageError for one that says none.

    Entry "" has a list of values, one for each number.
    """
    name, equals, text = word.partition("=")
    *entry, setting = name.strip().rsplit(".", 1)
    require(
        bool(equals) and setting in _KINDS,
        f"per_entry has {word!r}; write entry.setting=value, where the entry is a name, a place or {EVERY}, and the "
        f"setting is one of {', '.join(_KINDS)}",
    )
    try:
        value = ast.literal_eval(text.strip())
    except (ValueError, SyntaxError, MemoryError, RecursionError):
        value = text.strip()
    return "".join(entry), setting, value if entry else list(_listed(word, value))


def told(name: str, value: Any) -> list[str]:
    """The words of a setting whose value is a dictionary by entry, or a list with a value for each number."""
    if isinstance(value, Mapping):
        return [f"{entry}.{name}={_text(own)}" for entry, own in value.items()]
    if name == "bin_centers" and not any(isinstance(own, str) for own in value):
        return [f"{EVERY}.{name}={_text(value)}"]
    return [f"{name}={_text(value)}"]


def spread(words: Mapping[str, Any]) -> dict[str, Any]:
    """The words, where settings of single entries are said by `per_entry`.

    That is `n_bins=(5, 9)`, `eta={"wheel": 2.0}` or `bin_centers=(-1, -.1, 0, .1, 1)`.
    """
    found, own = dict(words), list[str]()
    for name in _KINDS:
        value = found.get(name)
        by_place = isinstance(value, Sequence) and not isinstance(value, str) and name not in _NUMBERS
        if isinstance(value, Mapping) or by_place:
            own += told(name, found.pop(name))
    given = found.get("per_entry", ())
    return found | ({"per_entry": (*given, *own)} if own else {})


def resolved(words: Sequence[str], box: Box, usual: Entry) -> tuple[Entry, ...]:
    """The settings of each entry of an action, in its order; choices have the usual ones.

    Raises:
        UsageError: a word that is none, a value out of range, or an entry that is no number in this box.
    """
    found = [usual] * len(box.low)
    for word in words:
        entry, setting, given = read(word)
        places = box.numbers if entry in ("", EVERY) else box.called(entry)
        require(
            bool(places) and set(places) <= set(box.numbers),
            f"per_entry has {word!r}, and {entry!r} is no number of the action; its entries are {', '.join(box.told)}",
        )
        values = [given] * len(places) if entry else given
        require(
            len(values) == len(places),
            f"per_entry has {word!r}, {len(values)} values, and the action has {len(places)} numbers",
        )
        for place, value in zip(places, values, strict=True):
            found[place] = found[place]._replace(**{setting: _checked(word, setting, value)})
    return tuple(
        own if isinstance(own.bin_centers, str) else own._replace(n_bins=len(own.bin_centers)) for own in found
    )


def etas(entries: Sequence[Entry]) -> np.ndarray | None:
    """The width of each entry's target, NaN where it is the loss's; None where it is everywhere."""
    given = [np.nan if entry.eta is None else entry.eta for entry in entries]
    return None if np.isnan(given).all() else np.array(given)


def most_bins(policy: object) -> int:
    """The largest number of bins that an entry can have under this policy, before a box is known."""
    own = [value for _, setting, value in map(read, getattr(policy, "per_entry", ())) if setting == "n_bins"]
    each = [n for value in own for n in (value if isinstance(value, list) else [value])]
    return int(max([getattr(policy, "n_bins", 1), *(n for n in each if isinstance(n, int))]))


_KINDS: dict[str, Any] = {
    "n_bins": Annotated[int, AtLeast(2)],
    "bin_centers": Centers,
    "initial_policy": Start,
    "eta": Positive,
}
_NUMBERS = ("eta",)
"""A list of these numbers is one for each run."""


def _checked(word: str, setting: str, value: Any) -> Any:
    if setting == "bin_centers" and not isinstance(value, str):
        return tuple(_listed(word, value))
    return checked(f"{setting} in {word!r}", value, _KINDS[setting])


def _listed(word: str, value: Any) -> Sequence[Any]:
    if not isinstance(value, list | tuple):
        raise UsageError(f"per_entry has {word!r}; say of which entry, or give a list with a value for each number")
    return value


def _text(value: Any) -> str:
    return str(np.asarray(value).tolist())
