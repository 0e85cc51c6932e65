"""galton report: figures and page from what was trained, without training anything."""

import dataclasses
from collections.abc import Sequence
from pathlib import Path

import tyro

from galton.analysis.plots import save
from galton.errors import require
from galton.studies import report, reproduce
from galton.sweep.store import Store


@dataclasses.dataclass(frozen=True)
class Options:
    """Draw the figures and write the page, from the summaries that `galton reproduce` left in a folder."""

    folder: tyro.conf.Positional[Path]
    """The folder; its data are read, figures/ and index.html are written."""


def main(arguments: Sequence[str]) -> None:
    """Read, draw, write."""
    write(tyro.cli(Options, prog="galton report", args=list(arguments)).folder)


def write(folder: Path) -> None:
    """Figures and page of a folder; the same data give the same bytes.

    Raises:
        UsageError: a folder without data.
    """
    data = reproduce.load(str(folder))
    there = bool(data.sweeps) or data.propositions is not None
    require(there, f"folder is {str(folder)!r}, which holds no data; make some with: galton reproduce")
    figures = report.figures(data)
    (folder / "figures").mkdir(exist_ok=True)
    for name, figure in figures.items():
        save(figure, folder / "figures" / name)
    Store(str(folder)).write("index.html", report.page(data, figures).encode())
    print(f"{len(figures)} figures and the page: {folder / 'index.html'}")
