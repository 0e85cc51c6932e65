"""A study as one record: what is trained for a figure, how it is drawn, and what it says of the paper."""

import dataclasses
from collections.abc import Callable
from typing import Any

import pyarrow as pa
from matplotlib.figure import Figure

from galton_experiments.analysis import AXES
from galton_experiments.page import Matrix, Table
from studies.paper.prose import text
from studies.paper.sweeps import Budget, Sweep
from studies.paper.trained import Trained


@dataclasses.dataclass(frozen=True)
class FigureStudy:
    """One figure of the page, with all that belongs to it."""

    title: str
    """Its heading on the page."""
    caption: str
    """The caption below the figure, which says what it shows in whole sentences."""
    draw: Callable[[Trained], Figure]
    """Draws it from what was trained, which may lack some of its sweeps but not all; without axes it is left out."""
    sweeps: tuple[Sweep, ...] = ()
    """The sweeps that it needs; figures may share sweeps, which are then trained once."""
    number: int | None = None
    """Its number in the paper; None for a figure that the paper does not have."""
    table: Callable[[Trained], Table | Matrix] | None = None
    """Makes the table of numbers below the figure, where that is drawn."""
    measure: Callable[[Budget], pa.Table] | None = None
    """Measures what no sweep trains; the figure finds it in `Trained.tables` under its name."""
    check: Callable[[pa.Table], None] = lambda _: None
    """Raises UsageError for a table of a file that `measure` can't have made."""

    def is_there(self, name: str, trained: Trained) -> bool:
        """Say whether anything was trained or measured for it, or it needs nothing."""
        needs_nothing = not self.sweeps and self.measure is None
        return needs_nothing or name in trained.tables or any(sweep.name in trained.sweeps for sweep in self.sweeps)


def figure(name: str, draw: Callable[[Trained], Figure], sweeps: tuple[Sweep, ...] = (), **parts: Any) -> FigureStudy:
    """A figure whose title and caption stand in figures.toml; `filled` are the words that these lack."""
    shared = {"axes": AXES, "bands": text("figures")["bands"]} | parts.pop("filled", {})
    told = text("figures")[name]
    title, caption = (told[part].format(**shared) for part in ("title", "caption"))
    return FigureStudy(title, caption, draw, sweeps, **{"number": told.get("number")} | parts)
