"""One vocabulary says whether one sample is above another: marks, their words, and numbers as they are written."""

import math
from collections.abc import Mapping
from typing import NamedTuple, Protocol, TypeVar, runtime_checkable

import numpy as np

from galton_experiments.analysis.statistics import ALPHA, Interval, holm

WORDS = {"✓": "better", "✗": "worse", "≈": "no clear difference", "?": "too few runs"}
"""Each mark says this of the first sample of a comparison."""
_Key = TypeVar("_Key")


@runtime_checkable
class Decidable(Protocol):
    """A Comparison can be decided, or anything with its test and its direction."""

    @property
    def p(self) -> float:
        """Of the test that there is no difference; NaN with too few runs."""

    @property
    def direction(self) -> int:
        """1 or −1 where it points one way or the other, 0 where it points nowhere."""


class Decision(NamedTuple):
    """A decision on one comparison among several is a mark and an adjusted p."""

    mark: str
    """The mark is a key of WORDS, which has its meaning in words."""
    p: float
    """Adjusted for all that were decided together by Holm's method."""


def decide(found: Mapping[_Key, Decidable]) -> dict[_Key, Decision]:
    """Decide each comparison: their p are adjusted together, and those below ALPHA are clear."""
    adjusted = holm([each.p for each in found.values()]).tolist()
    return {key: Decision(mark(found[key].direction, p), p) for key, p in zip(found, adjusted, strict=True)}


def mark(direction: int, p: float) -> str:
    """The mark of what points in a direction with an adjusted p."""
    if math.isnan(p):
        return "?"
    return {1: "✓", -1: "✗", 0: "≈"}[direction] if p < ALPHA else "≈"


def rounded(value: Interval, plus: str = "+") -> str:
    """An interval as text, with fewer decimals where its numbers are large."""
    largest = np.nanmax(np.abs([*value])) if np.isfinite([*value]).any() else 0.0
    return f"{value:{plus}{'.2f' if largest < 100 else ',.0f'}}"
