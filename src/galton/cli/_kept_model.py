"""The model's file of a run: saved as it trains, and soon after an interrupt, however long an update takes."""

import contextlib
import threading
import time
from collections.abc import Callable
from pathlib import Path

from galton.errors import UsageError
from galton.models import Model
from galton.models.file import Taken

SECONDS = 2.0
"""The seconds that training has to stop by itself after an interrupt, before what was taken last is saved; and how long
at least lies between two takings."""
SHARE = 0.01
"""The share of the time that taking may cost."""


class KeptModel:
    """Writes one model again and again to a path, from the thread that trains it or another.

    Before the first time `begin` makes the run's folder with the model, if `may_begin` says that there is room.
    """

    def __init__(self, path: Path, begin: Callable[[Taken], None], may_begin: Callable[[], bool]) -> None:
        self._path, self._begin, self._may_begin = path, begin, may_begin
        self._lock, self._ended = threading.Lock(), threading.Event()
        self._taken: Taken | None = None
        self._due = 0.0
        self._saved = -1
        self.begun = False

    def save(self, model: Model) -> None:
        """Write the model as it is now."""
        self._write(model.take())

    def take(self, model: Model) -> None:
        """Remember what would be written now, unless that was done a moment ago."""
        start = time.monotonic()
        if start >= self._due:
            self._taken = model.take()
            end = time.monotonic()
            self._due = end + max(SECONDS, (end - start) / SHARE)

    def end(self) -> None:
        """Training has stopped, and what was to be saved is."""
        self._ended.set()

    def save_taken(self) -> None:
        """Write what was taken last, unless training stops by itself in a moment: for a thread of its own."""
        if self._ended.wait(SECONDS):
            return
        taken = self._taken
        if taken is not None and self._may_begin():
            with contextlib.suppress(UsageError):  # the thread that trains will say so
                self._write(taken)

    def _write(self, taken: Taken) -> None:
        """Write it, unless something later is there."""
        with self._lock:
            if taken.num_timesteps < self._saved:
                return
            if self.begun:
                taken.save(self._path)
            else:
                self._begin(taken)
            self.begun, self._saved = True, taken.num_timesteps
