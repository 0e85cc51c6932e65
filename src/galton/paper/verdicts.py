"""How differences become verdicts on the paper's claims, and words for them."""

from collections.abc import Iterable, Mapping

import numpy as np

from galton.analysis.statistics import Interval
from galton.page.page import Claim

UNKNOWN = "not decidable here"
NOT_TRAINED = "What it needs was not trained."
A_TENTH = 0.1
"""The share of what training gains below which a difference is called little."""


def claim(source: str, words: str, test: str, gaps: Mapping[str, Interval], *notes: str) -> Claim:
    """A sentence of the paper, judged by differences that it says are positive.

    Args:
        source: where it stands.
        words: the sentence.
        test: what was compared with what.
        gaps: the differences, by what the page calls them; none where nothing was trained.
        notes: further sentences, each on a line of its own.
    """
    return Claim(source, words, test, listed(gaps), verdict(gaps.values()), sorted_out(gaps, *notes))


def decided(gaps: Mapping[str, Interval]) -> dict[str, Interval]:
    """The differences that have an interval, which too few trials do not give."""
    return {name: gap for name, gap in gaps.items() if not np.isnan(gap.low)}


def verdict(gaps: Iterable[Interval]) -> str:
    """The verdict on differences that the paper says are positive.

    It holds if all clearly are, and does not if more are clearly negative than positive. One without an interval, for
    too few trials, does not count; where none is clearly either, nothing is decided.
    """
    known = [gap for gap in gaps if not np.isnan(gap.low)]
    n_positive, n_negative = sum(gap.low > 0 for gap in known), sum(gap.high < 0 for gap in known)
    if n_positive == n_negative == 0:
        return UNKNOWN
    return "holds" if n_positive == len(known) else "holds in part" if n_positive >= n_negative else "does not hold"


def listed(gaps: Mapping[str, Interval], spec: str = "+.2f") -> str:
    """The differences as text, each with its name on a line of its own."""
    return "\n".join(f"{name} {gap:{spec}}" for name, gap in gaps.items())


def sorted_out(gaps: Mapping[str, Interval], *notes: str) -> str:
    """Which are clearly as the paper says, positive, and which the other way round or neither; a line for each note."""
    sentence = named(gaps)
    return "\n".join([f"{sentence[0].upper()}{sentence[1:]}.", *filter(None, notes)]) if gaps else NOT_TRAINED


def named(gaps: Mapping[str, Interval]) -> str:
    """The names of the differences as text, sorted by what is clear of them."""
    known = decided(gaps)
    words = {
        "as the paper says": [name for name, gap in known.items() if gap.low > 0],
        "the other way round": [name for name, gap in known.items() if gap.high < 0],
        "no clear difference": [name for name, gap in known.items() if gap.low <= 0 <= gap.high],
        "too few trials": [name for name in gaps if name not in known],
    }
    return "; ".join(f"{word}: {', '.join(names)}" for word, names in words.items() if names)
