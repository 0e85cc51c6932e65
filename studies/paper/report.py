"""The page: the answer, what holds of the paper, every figure, and how all was made; and the tables that docs quote."""

import dataclasses
from collections.abc import Mapping
from pathlib import Path

from matplotlib.figure import Figure

from galton_experiments.analysis.plots import images, settle
from galton_experiments.page import VERDICTS, Claim, Matrix, Section, quotes, render
from galton_experiments.sweep import Store
from studies.paper import hypotheses, made, rescaling
from studies.paper.answer import answer
from studies.paper.claims import CLAIMS
from studies.paper.figure import FigureStudy
from studies.paper.prose import text
from studies.paper.registry import FIGURES
from studies.paper.standings import readme_table
from studies.paper.trained import Trained

FIRST = (hypotheses.NAME,)
"""The figures that stand before the claims."""
FILE = "tables.md"
_SIGNS = dict(zip(VERDICTS, "✓◐✗≈", strict=True))


def figures(trained: Trained) -> dict[str, Figure]:
    """Every figure, drawn, for which enough was trained to draw something."""
    drawn = {name: figure.draw(trained) for name, figure in FIGURES.items() if figure.is_there(name, trained)}
    drawn = {name: figure for name, figure in drawn.items() if figure.axes}
    for figure in drawn.values():
        settle(figure)
    return drawn


def page(trained: Trained, drawn: Mapping[str, Figure]) -> str:
    """The whole page as HTML, with the figures that were drawn."""
    judged = claims(trained)
    sections = [_section(name, figure, trained, drawn.get(name)) for name, figure in FIGURES.items()]
    there = [made.section(trained)] if trained.sweeps or trained.tables else []
    head = answer(trained, judged)
    if head.figure is not None:
        settle(head.figure)
    return render(text("page")["title"], text("page")["introduction"], judged, [*sections, *there], head)


def write(folder: Path, trained: Trained) -> None:
    """Figures and page into a folder; the same data give the same bytes."""
    drawn, store = figures(trained), Store(str(folder))
    html = page(trained, drawn)  # before anything is written, for it may be refused
    pictures = {f"{name}{suffix}": image for name in drawn for suffix, image in images(drawn[name]).items()}
    for name, image in pictures.items():
        store.write(f"figures/{name}", image)
    for name in {f"{figure}{suffix}" for figure in FIGURES for suffix in (".png", ".svg")} - {*pictures}:
        store.remove(f"figures/{name}")  # of what a former version drew, or from data that have gone
    store.write("index.html", html.encode())
    store.write(FILE, document(trained).encode())
    print(f"{len(drawn)} figures and the page: {folder / 'index.html'}")


def claims(trained: Trained) -> list[Claim]:
    """Judge the claims of all figures, each of which rests on the section of its figure."""
    return [dataclasses.replace(judge(trained), section=name) for name, judge in CLAIMS]


def _section(name: str, figure: FigureStudy, trained: Trained, drawn: Figure | None) -> Section:
    title = figure.title if figure.number is None else f"Figure {figure.number}: {figure.title}"
    table = figure.table(trained) if figure.table and drawn else None
    missing = () if drawn else ("Not trained here.",)
    return Section(name, title, figure.caption, drawn, table, missing, name in FIRST)


def tables(trained: Trained) -> dict[str, str]:
    """The tables that documents quote, as Markdown, by name; those that lack their data are left out."""
    found = {
        "Final training return on fresh seeds": readme_table(trained) if trained.judged else "",
        FIGURES[hypotheses.NAME].title: markdown(hypotheses.table(trained)),
        "Figure 3 in both units": markdown(rescaling.table(trained)),
        "The scale of the action box": rescaling.markdown(trained),
    }
    return {name: table for name, table in found.items() if table}


def document(trained: Trained) -> str:
    """All tables, each under a heading."""
    signs = ", ".join(f"{sign} {verdict}" for verdict, sign in _SIGNS.items())
    head = f"# Tables\n\nOf how many tasks, losses or sizes a claim clearly holds: {signs}.\n"
    return head + "".join(f"\n## {name}\n\n{table}\n" for name, table in tables(trained).items())


def markdown(matrix: Matrix) -> str:
    """A matrix of verdicts as a Markdown table; "" without rows."""
    if not matrix.rows:
        return ""
    rows = [
        [name, *(f"{_SIGNS[cell.verdict]} {cell.text}" if cell.verdict else cell.text for cell in cells)]
        for name, cells in matrix.rows.items()
    ]
    return quotes.markdown([matrix.corner, *matrix.columns], rows)
