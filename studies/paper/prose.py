"""The page's words, from the TOML files of the folder `text`, each read once."""

import functools
import re
import tomllib
from pathlib import Path
from typing import Any


@functools.cache
def text(file: str) -> dict[str, Any]:
    """Read a file of the folder; the lines of a paragraph are joined."""
    return _joined(tomllib.loads((Path(__file__).parent / "text" / f"{file}.toml").read_text(encoding="utf-8")))


def says(claim: str, **filled: str) -> tuple[str, str, str]:
    """Of a claim where it stands, the sentence, and what is compared with what.

    Args:
        claim: its name in claims.toml.
        filled: what stands for the {words} in it.
    """
    source, words, test = (text("claims")[claim][part].format(**filled) for part in ("source", "words", "test"))
    return source, words, test


def note(claim: str, **filled: str) -> str:
    """Return what else is said of a claim."""
    return str(text("claims")[claim]["note"]).format(**filled)


def _joined(value: Any) -> Any:
    if isinstance(value, dict):
        return {name: _joined(entry) for name, entry in value.items()}
    if isinstance(value, list):
        return [*map(_joined, value)]
    return re.sub(r" ?\n", " ", value.strip("\n")) if isinstance(value, str) else value
