"""What is printed keeps its meaning in any encoding, and a pipe that nobody reads is no error."""

import io
import os
import subprocess
import sys

import pytest

from galton.cli._output import keep_signs


def unread_pipe():
    """A pipe that nobody reads any more."""
    read, write = os.pipe()
    os.close(read)
    return write


@pytest.mark.parametrize(
    ("encoding", "printed"),
    [
        ("ascii", "-1.5 +- 2.0 eta 3x? -?"),
        ("latin-1", "-1.5 ± 2.0 eta 3×? -?"),
        ("cp437", "-1.5 ± 2.0 eta 3x? -?"),
        ("utf-8", "−1.5 ± 2.0 η 3×ж —?"),
    ],
)
def test_what_an_encoding_lacks_keeps_its_meaning_where_it_can(encoding, printed, monkeypatch):
    """A minus stays one; a letter is a question mark, and so is a byte of a path that is no text."""
    below = io.BytesIO()
    monkeypatch.setattr(sys, "stdout", io.TextIOWrapper(below, encoding=encoding))
    keep_signs()
    print("−1.5 ± 2.0 η 3×ж —\udcff", end="", flush=True)
    assert below.getvalue().decode(encoding) == printed


def galton(*arguments, stdout, **options):
    command = [sys.executable, "-m", "galton", *map(str, arguments)]
    return subprocess.run(command, stdout=stdout, stderr=subprocess.PIPE, text=True, timeout=120, **options)


WORDS = [["--help"], ["--version"], ["train", "--help"], ["sweep", "status", "--help"]]


@pytest.mark.few
@pytest.mark.parametrize("words", WORDS, ids=" ".join)
def test_an_unread_pipe_ends_quietly_as_a_shell_shows_it(words):
    write = unread_pipe()
    done = galton(*words, stdout=write)
    os.close(write)
    assert (done.returncode, done.stderr) == (141, "")


@pytest.mark.few
@pytest.mark.parametrize("encoding", ["ascii", "latin-1"])
def test_help_can_be_printed_in_any_encoding(encoding):
    environment = os.environ | {"PYTHONIOENCODING": encoding}
    done = galton("train", "--help", stdout=subprocess.PIPE, env=environment, encoding=encoding)
    assert done.returncode == 0, done.stderr
    assert "--learning-rate FLOAT" in done.stdout
