"""The tables that README and docs quote, as Markdown: made from the data as the page is, and checked by the tests.

A document says <!-- table: NAME --> where one stands, and `python -m galton.paper.tables FOLDER FILE ...` writes it.
"""

import re
import sys
from collections.abc import Mapping
from pathlib import Path

from galton.page.page import VERDICTS, Matrix
from galton.paper import boxed, hypotheses, reproduce, rescaling
from galton.paper.standings import readme_table
from galton.paper.trained import Trained
from galton.saving import files

FILE = "tables.md"
_SIGNS = dict(zip(VERDICTS, "✓◐✗≈", strict=True))
_PLACE = re.compile(r"(<!-- table: (.+?) -->\n\n)((?:\|.*\n)*)\n?")


def tables(trained: Trained) -> dict[str, str]:
    """All of them by name; those that lack their data are left out."""
    found = {
        "Final training return on fresh seeds": readme_table(trained) if trained.judged else "",
        "What makes the paper's result appear?": markdown(hypotheses.table(trained)),
        "Figure 3 in both units": markdown(boxed.table(trained)),
        "The scale of the action box": rescaling.markdown(trained),
    }
    return {name: table for name, table in found.items() if table}


def document(trained: Trained) -> str:
    """All of them, each under a heading."""
    signs = ", ".join(f"{sign} {verdict}" for verdict, sign in _SIGNS.items())
    head = f"# Tables\n\nOf how many tasks, losses or sizes a claim clearly holds: {signs}.\n"
    return head + "".join(f"\n## {name}\n\n{table}\n" for name, table in tables(trained).items())


def markdown(matrix: Matrix) -> str:
    """A matrix of verdicts as a Markdown table; "" without rows."""
    if not matrix.rows:
        return ""
    lines = [f"| {matrix.corner} | " + " | ".join(matrix.columns) + " |", "|---" * (len(matrix.columns) + 1) + "|"]
    for name, cells in matrix.rows.items():
        shown = (f"{_SIGNS[cell.verdict]} {cell.text}" if cell.verdict else cell.text for cell in cells)
        lines.append(f"| {name} | " + " | ".join(shown) + " |")
    return "\n".join(lines)


def filled(text: str, known: Mapping[str, str]) -> str:
    """A document with its tables where it names them; one that is not known stays as it is."""
    return _PLACE.sub(lambda place: f"{place[1]}{known[place[2]]}\n\n" if place[2] in known else place[0], text)


def main(folder: str, *documents: str) -> None:
    """Write the tables of a folder of `galton reproduce` into documents."""
    known = tables(reproduce.load(folder))
    for path in map(Path, documents):
        files.write(path, filled(path.read_text(encoding="utf-8"), known).encode())


if __name__ == "__main__":
    main(*sys.argv[1:])
