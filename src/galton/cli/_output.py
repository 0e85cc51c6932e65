"""What the command prints on: whatever happens to a terminal, a pipe or a disk, the work behind it goes on."""

import codecs
import contextlib
import io
import os
import select
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

PLAIN = {"−": "-", "±": "+-", "–": "-", "—": "-", "…": "...", "×": "x", "η": "eta", "³": "^3", "¹": "1"}
"""What stands for a character where the output's encoding has none; anything else becomes a question mark."""


def _plain(error: UnicodeError) -> tuple[str, int]:
    """Replace what can't be encoded, so that numbers keep their signs."""
    assert isinstance(error, UnicodeEncodeError)
    return "".join(PLAIN.get(letter, "?") for letter in error.object[error.start : error.end]), error.end


codecs.register_error("galton.plain", _plain)


class Lasting(io.FileIO):
    """A stream that never fails: once it can't be written, it keeps the reason and takes the rest into nothing."""

    lost: OSError | None = None
    """Why it can't be written any more."""

    def write(self, data: Any, /) -> int:
        """Write all of it, or take it all the same."""
        left = memoryview(data).cast("B")
        while left and self.lost is None:
            try:
                written = super().write(left)
                if written is None:  # a pipe that does not wait is full
                    select.select([], [self], [])
                left = left[written or 0 :]
            except OSError as error:
                self.lost = error
        return len(data)


@contextlib.contextmanager
def lasting_output() -> Iterator[Lasting | None]:
    """A time in which printing can't fail, on stdout or stderr. What stands for stdout is given, if it is a file."""
    before = sys.stdout, sys.stderr
    (stdout, file), (stderr, _) = map(_lasting, before)
    sys.stdout, sys.stderr = stdout, stderr
    try:
        yield file
    finally:
        sys.stdout, sys.stderr = before
        stdout.flush()
        stderr.flush()


def _lasting(stream: Any) -> tuple[Any, Lasting | None]:
    """A stream of text that prints where this one does, and the file below it; what is no file stays what it is."""
    if stream is None:  # it was closed before Python began
        return Path(os.devnull).open("w"), None
    try:
        stream.flush()
        raw = Lasting(stream.fileno(), "w", closefd=False)
    except (OSError, ValueError):
        return stream, None
    errors = "backslashreplace" if stream.errors == "backslashreplace" else "galton.plain"
    text = io.TextIOWrapper(
        raw if stream.write_through else io.BufferedWriter(raw),
        encoding=stream.encoding,
        errors=errors,
        line_buffering=stream.line_buffering,
        write_through=stream.write_through,
    )
    return text, raw
