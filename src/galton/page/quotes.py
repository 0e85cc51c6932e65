"""Tables that documents quote, as Markdown: a document says <!-- table: NAME --> where one stands."""

import re
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path

from galton.saving import files

_PLACE = re.compile(r"(<!-- table: (.+?) -->\n\n)((?:\|.*\n)*)\n?")


def markdown(headings: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    """A table in Markdown."""
    lines = [headings, *rows]
    head, *body = ("| " + " | ".join(cells) + " |" for cells in lines)
    return "\n".join([head, "|---" * len(headings) + "|", *body])


def filled(text: str, known: Mapping[str, str]) -> str:
    """A document with its tables where it names them; one that is not known stays as it is."""
    return _PLACE.sub(lambda place: f"{place[1]}{known[place[2]]}\n\n" if place[2] in known else place[0], text)


def write(known: Mapping[str, str], documents: Iterable[str]) -> None:
    """Put tables into the documents that name them."""
    for path in map(Path, documents):
        files.write(path, filled(path.read_text(encoding="utf-8"), known).encode())
