"""Characters that the output's encoding lacks are printed as others that mean the same."""

import codecs
import io
import sys

PLAIN = {"−": "-", "±": "+-", "–": "-", "—": "-", "…": "...", "×": "x", "η": "eta", "³": "^3", "¹": "1"}
"""Characters that keep their meaning in ASCII; anything else becomes a question mark."""


def _plain(error: UnicodeError) -> tuple[str, int]:
    """Replace what can't be encoded, so that numbers keep their signs."""
    assert isinstance(error, UnicodeEncodeError)
    return "".join(PLAIN.get(letter, "?") for letter in error.object[error.start : error.end]), error.end


codecs.register_error("galton.plain", _plain)


def keep_signs() -> None:
    """Let stdout and stderr print what their encoding lacks as PLAIN has it, instead of raising."""
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper) and stream.errors == "strict":
            stream.reconfigure(errors="galton.plain")
