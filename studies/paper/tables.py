"""The tables that README and docs quote, as Markdown: made from the data as the page is, and checked by the tests.

A document says <!-- table: NAME --> where one stands, and `python -m studies.paper tables FOLDER FILE ...` writes it.
"""

from galton_experiments.page import VERDICTS, Matrix, quotes
from studies.paper import boxed, hypotheses, rescaling
from studies.paper.standings import readme_table
from studies.paper.trained import Trained

FILE = "tables.md"
_SIGNS = dict(zip(VERDICTS, "✓◐✗≈", strict=True))


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
    rows = [
        [name, *(f"{_SIGNS[cell.verdict]} {cell.text}" if cell.verdict else cell.text for cell in cells)]
        for name, cells in matrix.rows.items()
    ]
    return quotes.markdown([matrix.corner, *matrix.columns], rows)
