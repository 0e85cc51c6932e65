"""The tables that README and docs quote, as Markdown: made from the data as the page is, and checked by the tests."""

from collections.abc import Mapping

from galton.page.page import VERDICTS, Matrix
from galton.paper import boxed, hypotheses
from galton.paper.standings import readme_table
from galton.paper.trained import Trained

FILE = "tables.md"
_SIGNS = dict(zip(VERDICTS, "✓◐✗≈", strict=True))


def document(trained: Trained) -> str:
    """All of them, each under a heading."""
    found: Mapping[str, str] = {
        "Final training return on fresh seeds": readme_table(trained) if trained.judged else "",
        "What makes the paper's result appear?": markdown(hypotheses.table(trained)),
        "Figure 3 in both units": markdown(boxed.table(trained)),
    }
    signs = ", ".join(f"{sign} {verdict}" for verdict, sign in _SIGNS.items())
    head = f"# Tables\n\nOf how many tasks, losses or sizes a claim clearly holds: {signs}.\n"
    return head + "".join(f"\n## {title}\n\n{table}\n" for title, table in found.items() if table)


def markdown(matrix: Matrix) -> str:
    """A matrix of verdicts as a Markdown table; "" without rows."""
    if not matrix.rows:
        return ""
    lines = [f"| {matrix.corner} | " + " | ".join(matrix.columns) + " |", "|---" * (len(matrix.columns) + 1) + "|"]
    for name, cells in matrix.rows.items():
        shown = (f"{_SIGNS[cell.verdict]} {cell.text}" if cell.verdict else cell.text for cell in cells)
        lines.append(f"| {name} | " + " | ".join(shown) + " |")
    return "\n".join(lines)
