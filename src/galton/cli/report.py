"""galton report: figures and page from what was trained, without training anything."""

import dataclasses
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Annotated

import tyro

from galton.analysis import plots
from galton.cli._modules import import_typed
from galton.cli._reading import read_options
from galton.errors import require
from galton.paper import report, reproduce, tables
from galton.paper.registry import FIGURES
from galton.paper.trained import Trained
from galton.sweep.store import Store


@dataclasses.dataclass(frozen=True)
class Options:
    """Draw the figures and write the page, from the summaries that `galton reproduce` left in a folder."""

    folder: Annotated[Path, tyro.conf.Positional, tyro.conf.arg(metavar="DIR")]
    """The folder; its data are read, figures/, index.html and tables.md are written."""
    imports: tuple[str, ...] = ()
    """Modules to import first, where figures of your own are registered."""


def main(arguments: Sequence[str]) -> None:
    """Read what was trained, draw the figures and write the page.

    Raises:
        UsageError: a folder without data.
    """
    options = read_options(Options, "report", arguments)
    import_typed(options.imports)
    folder = options.folder
    trained = reproduce.load(str(folder))
    for file in reproduce.of_no_figure(str(folder)):
        told = "is of no figure and left out; name the module that registers its study with --imports"
        print(f"galton: {reproduce.DATA}/{file} {told}", file=sys.stderr)
    there = bool(trained.sweeps or trained.tables)
    require(there, f"folder is {str(folder)!r}, which holds no data; make some with: galton reproduce")
    write(folder, trained)


def write(folder: Path, trained: Trained) -> None:
    """Figures and page into a folder; the same data give the same bytes."""
    figures, store = report.figures(trained), Store(str(folder))
    page = report.page(trained, figures)  # before anything is written, for it may be refused
    images = {f"{name}{suffix}": image for name in figures for suffix, image in plots.images(figures[name]).items()}
    for name, image in images.items():
        store.write(f"figures/{name}", image)
    for name in {f"{figure}{suffix}" for figure in FIGURES for suffix in (".png", ".svg")} - {*images}:
        store.remove(f"figures/{name}")  # of what a former version drew, or from data that have gone
    store.write("index.html", page.encode())
    store.write(tables.FILE, tables.document(trained).encode())
    print(f"{len(figures)} figures and the page: {folder / 'index.html'}")
