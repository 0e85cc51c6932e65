"""The figures by name. Importing this draws nothing."""

import importlib

from galton.errors import UsageError
from galton.studies.base import FigureStudy

FIGURES = (*(f"figure-{i}" for i in range(1, 10)), "propositions", "why")
"""In the order of the page. Each is a module of galton.studies with a FIGURE."""


def find_figure(name: str) -> FigureStudy:
    """The figure of that name; UsageError lists the names if there is none."""
    if name not in FIGURES:
        raise UsageError(f"figure is {name!r}; choose from {', '.join(FIGURES)}")
    figure: FigureStudy = importlib.import_module(f"galton.studies.{name.replace('-', '_')}").FIGURE
    return figure
