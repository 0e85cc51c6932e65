"""Training in short pieces, between which somebody can look in: a bar, a clock, Ctrl-C."""

import time
from collections.abc import Callable

SECONDS = 0.5
"""About how long a piece takes, unless a single update takes longer."""


class Pieces:
    """Cuts training by `advance` into pieces of half a second. How long an update takes is learnt on the way."""

    def __init__(self, advance: Callable[[int], None]) -> None:
        self._advance, self._n = advance, 1

    def train(self, at_most: int) -> int:
        """Train for a piece of at most so many updates, and return how many they were."""
        n, start = min(self._n, at_most), time.perf_counter()
        self._advance(n)
        seconds = max(time.perf_counter() - start, 1e-9)
        if n == self._n or seconds > SECONDS:
            self._n = max(1, min(2 * n, int(n * SECONDS / seconds)))
        return n
