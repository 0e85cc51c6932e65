"""A field of a setting is drawn from a prior, by quantiles, which a Latin hypercube can stratify."""

import dataclasses
import math
from collections.abc import Collection, Mapping
from typing import Any

from galton.errors import UsageError, did_you_mean, require
from galton.words import vocabulary

Record = Mapping[str, Any]
"""A TOML file, or a table of it."""
CONTINUOUS = ("uniform", "log-uniform", "log-uniform-below-1")
"""The kinds of prior between two ends; of the last one it is 1 − x whose logarithm is uniform, as suits a discount."""
KINDS = (*CONTINUOUS, "choice", "value")
"""All kinds: a choice has values of equal chances, and a value is always the same."""
STEPS = "steps"
"""The one word for a table's `times`: the number counts in lengths of the whole run."""
MOST = 1e30
"""The bound on the size of numbers: float32, in which runs hold them, ends at 3e38."""
_FORMS = "write a table such as { log-uniform = [1e-4, 1e-2] }, { uniform = [0, 1] } or { choice = [50, 100] }"


@dataclasses.dataclass(frozen=True)
class Prior:
    """A distribution over the values of one field, or a value that is fixed."""

    kind: str
    """The key in KINDS of how values are drawn."""
    values: tuple[Any, ...]
    """The two ends, the values to choose from, or the one value."""
    in_steps: bool = False
    """True if a value is a multiple of the number of environment steps that the run has."""

    @classmethod
    def read(cls, where: str, given: object) -> "Prior":
        """The prior that a TOML value describes; what is no table is a value.

        Args:
            where: the value's place in the file, for messages.
            given: the value.

        Raises:
            UsageError: a table that describes none.
        """
        if not isinstance(given, dict):
            return cls("value", (given,))
        kinds = [name for name in given if name in KINDS]
        odd = [name for name in given if name not in (*KINDS, "times")]
        require(len(kinds) == 1 and not odd, f"{where} is {given}, which is no prior; {_FORMS}")
        times = given.get("times", STEPS)
        require(times == STEPS, f'{where}.times is {times!r}; leave it out, or write times = "{STEPS}"')
        kind, values = kinds[0], given[kinds[0]]
        if kind == "value":
            values = [values]
        wanted = "two numbers" if kind in CONTINUOUS else "one value or more"
        right = isinstance(values, list) and (len(values) == 2 if kind in CONTINUOUS else len(values) >= 1)
        require(right, f"{where}.{kind} is {values!r}; give a list of {wanted}")
        prior = cls(kind, tuple(values), "times" in given)
        prior.check(f"{where}.{kind}")
        return prior

    @property
    def is_drawn(self) -> bool:
        """True if its values differ from draw to draw."""
        return self.kind != "value"

    def check(self, where: str) -> None:
        """Raise UsageError for ends that are no range, and for values that can't be multiplied by steps."""
        if self.in_steps or self.kind in CONTINUOUS:
            for value in self.values:
                right = isinstance(value, int | float) and not isinstance(value, bool) and abs(value) < MOST
                require(right, f"{where} has {value!r}; it must have finite numbers, less than {MOST:g}")
        if self.kind in CONTINUOUS:
            low, high = self.values
            require(low < high, f"{where} is {[*self.values]}; its first number must be less than its second")
            require(self.kind != "log-uniform" or low > 0, f"{where} is {[*self.values]}; its numbers must be above 0")
            below = self.kind != "log-uniform-below-1" or high < 1
            require(below, f"{where} is {[*self.values]}; its numbers must be below 1")

    def at(self, quantile: float) -> Any:
        """The value at a quantile from 0 to 1, rounded to four digits: what a table shows is what is trained."""
        if self.kind not in CONTINUOUS:
            return self.values[min(int(quantile * len(self.values)), len(self.values) - 1)]
        low, high = map(float, self.values)
        if self.kind == "uniform":
            found = _short(low + quantile * (high - low))
        elif self.kind == "log-uniform":
            found = _short(_between(low, high, quantile))
        else:
            found = round(1 - _short(_between(1 - low, 1 - high, quantile)), 12)
        return min(max(found, low), high)

    def told(self) -> str:
        """The prior in a few words, for a table."""
        if self.kind in CONTINUOUS:
            low, high = self.values
            text = f"{self.kind} {low:g} … {high:g}"
        else:
            text = ", ".join(f"{value:.12g}" if isinstance(value, float) else f"{value}" for value in self.values)
        return f"{text} × steps" if self.in_steps else text


Priors = Mapping[str, Prior]
"""Priors, or fixed values, by the setting."""


def read_table(where: str, given: object, drawn: bool) -> dict[str, Prior]:
    """A table of fields with their priors, or with fixed values.

    Raises:
        UsageError: an unknown field, a value where there must be a prior or the other way round.
    """
    known = vocabulary()
    named = check_names(where, given, known.usual, "which is no setting")
    found = {name: Prior.read(f"{where}.{name}", value) for name, value in named.items()}
    for name, prior in found.items():
        place = f"{where}.{name}"
        if drawn:
            require(prior.is_drawn, f"{place} is {prior.values[0]!r}, which is no prior; fix it in a fixed table")
        else:
            require(not prior.is_drawn, f"{place} is a prior; move it to prior, or to the search of a method")
        number = known.is_number(name)
        changes = f"{place} is {prior.kind}, but each value of {name} is a program of its own; write"
        require(number or prior.kind not in CONTINUOUS, f"{changes} {{ choice = [...] }}")
        require(number or not prior.in_steps, f"{place} has times, which goes with a number that no program depends on")
    return found


def check_names(where: str, given: object, known: Collection[str], otherwise: str = "") -> Record:
    """A table of the file, if it has no other names than these.

    Raises:
        UsageError: no table, or an unknown name in it.
    """
    if not isinstance(given, dict):
        raise UsageError(f"{where} is {given!r}; it must be a table")
    for name in given:
        if name not in known:
            meant = did_you_mean(name, known)
            told = otherwise or f"which it can't have; it takes {', '.join(known)}"
            raise UsageError(f"{where} has {name!r}, {told}{meant}")
    return given


def _between(low: float, high: float, quantile: float) -> float:
    """The point between two positive numbers at a quantile, by logarithm."""
    return math.exp(math.log(low) + quantile * (math.log(high) - math.log(low)))


def _short(number: float) -> float:
    return float(f"{number:.4g}")
