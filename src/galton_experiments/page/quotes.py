"""Tables that documents quote, as Markdown: a document says <!-- table: NAME --> where one stands."""

import re
from collections.abc import Callable, Iterable, Sequence
from pathlib import Path

from galton.saving import files

_PLACE = re.compile(r"(<!-- table: (.+?) -->\n\n)((?:\|.*\n)*)\n?")


def markdown(headings: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    """A table in Markdown."""
    lines = [headings, *rows]
    head, *body = ("| " + " | ".join(cell.replace("|", "\\|") for cell in cells) + " |" for cells in lines)
    return "\n".join([head, "|---" * len(headings) + "|", *body])


def filled(text: str, table: Callable[[str], str | None]) -> str:
    """A document with its tables where it names them; one that is not known, `table(name)` None, stays as it is."""

    def put(place: re.Match[str]) -> str:
        found = table(place[2])
        return place[0] if found is None else f"{place[1]}{found}\n\n"

    return _PLACE.sub(put, text)


def write(table: Callable[[str], str | None], documents: Iterable[str]) -> None:
    """Put tables into the documents that name them."""
    for path in map(Path, documents):
        files.write(path, filled(path.read_text(encoding="utf-8"), table).encode())
