"""Whatever becomes of a terminal, a pipe or a disk: printing can't fail, and the exit code tells."""

import errno
import fcntl
import io
import os
import subprocess
import sys
import threading

import pytest

from galton.cli._output import lasting_output

TALL = "a line\n" * 50_000


@pytest.fixture
def stdout_on(monkeypatch):
    """A function that makes sys.stdout print into a file descriptor, in an encoding."""

    def put(descriptor, encoding="utf-8", *, write_through=False):
        raw = io.FileIO(descriptor, "w", closefd=False)
        below = raw if write_through else io.BufferedWriter(raw)
        monkeypatch.setattr(sys, "stdout", io.TextIOWrapper(below, encoding=encoding, write_through=write_through))

    return put


def unread_pipe():
    """A pipe that nobody reads any more."""
    read, write = os.pipe()
    os.close(read)
    return write


def full_disk():
    return os.open("/dev/full", os.O_WRONLY)


def hung_up():
    """A terminal whose other end is gone."""
    ours, its = os.openpty()
    os.close(ours)
    return its


def read_only():
    return os.open(os.devnull, os.O_RDONLY)


@pytest.mark.skipif(sys.platform != "linux", reason="/dev/full is Linux's")
@pytest.mark.parametrize("write_through", [False, True])
@pytest.mark.parametrize(
    ("opened", "reason"),
    [(unread_pipe, errno.EPIPE), (full_disk, errno.ENOSPC), (hung_up, errno.EIO), (read_only, errno.EBADF)],
)
def test_printing_never_fails_and_the_reason_is_known(opened, reason, write_through, stdout_on):
    descriptor = opened()
    stdout_on(descriptor, write_through=write_through)
    with lasting_output() as file:
        for _ in range(3):
            print(TALL)
        print("the end", flush=True)
        assert file.lost.errno == reason
    sys.stdout.flush()
    os.close(descriptor)


@pytest.mark.parametrize("write_through", [False, True])
def test_a_slow_reader_of_a_pipe_that_does_not_wait_gets_everything(write_through, stdout_on):
    read, write = os.pipe()
    fcntl.fcntl(write, fcntl.F_SETFL, os.O_NONBLOCK)
    stdout_on(write, write_through=write_through)
    got = []
    reader = threading.Thread(target=lambda: got.extend(iter(lambda: os.read(read, 1000), b"")), daemon=True)
    later = threading.Timer(0.2, reader.start)
    later.start()
    with lasting_output() as file:
        print(TALL, end="")
    later.join()
    os.close(write)
    reader.join()
    os.close(read)
    assert (b"".join(got).decode(), file.lost) == (TALL, None)


@pytest.mark.parametrize(
    ("encoding", "printed"),
    [
        ("ascii", "-1.5 +- 2.0 eta 3x? -?"),
        ("latin-1", "-1.5 ± 2.0 eta 3×? -?"),
        ("cp437", "-1.5 ± 2.0 eta 3x? -?"),
        ("utf-8", "−1.5 ± 2.0 η 3×ж —?"),
    ],
)
def test_what_an_encoding_lacks_keeps_its_meaning_where_it_can(encoding, printed, tmp_path, stdout_on):
    """A minus stays one; a letter is a question mark, and so is a byte of a path that is no text."""
    with (tmp_path / "out").open("wb") as file:
        stdout_on(file.fileno(), encoding)
        with lasting_output():
            print("−1.5 ± 2.0 η 3×ж —\udcff", end="")
    assert (tmp_path / "out").read_bytes().decode(encoding) == printed


def test_a_stream_that_is_no_file_is_left_alone(monkeypatch):
    monkeypatch.setattr(sys, "stdout", io.StringIO())
    with lasting_output() as file:
        print("told", end="")
    assert (sys.stdout.getvalue(), file) == ("told", None)


def galton(*arguments, stdout, **options):
    command = [sys.executable, "-m", "galton", *map(str, arguments)]
    return subprocess.run(command, stdout=stdout, stderr=subprocess.PIPE, text=True, timeout=120, **options)


WORDS = [["--help"], ["--version"], ["train", "--help"], ["sweep", "status", "--help"]]


@pytest.mark.parametrize("words", WORDS, ids=" ".join)
def test_an_unread_pipe_ends_quietly_as_a_shell_shows_it(words):
    write = unread_pipe()
    done = galton(*words, stdout=write)
    os.close(write)
    assert (done.returncode, done.stderr) == (141, "")


@pytest.mark.skipif(sys.platform != "linux", reason="/dev/full is Linux's")
def test_a_full_disk_behind_stdout_is_told_in_a_line():
    descriptor = full_disk()
    done = galton("--help", stdout=descriptor)
    os.close(descriptor)
    assert done.returncode == 2
    assert done.stderr == "galton: standard output can't be written: [Errno 28] No space left on device\n"


def test_a_wrong_argument_keeps_its_code_when_nobody_reads():
    write = unread_pipe()
    done = galton("train", "bandit", "--loss", "mse", stdout=write)
    os.close(write)
    assert (done.returncode, done.stderr.count("\n")) == (2, 1)


@pytest.mark.skipif(os.name != "posix", reason="a shell closes the streams")
@pytest.mark.parametrize("closed", [">&-", "2>&-", ">&- 2>&-", "<&- >&- 2>&-"])
def test_streams_that_were_closed_before_it_began_are_no_trouble(closed):
    command = ["sh", "-c", f'exec "$@" {closed}', "sh", sys.executable, "-m", "galton", "--help"]
    done = subprocess.run(command, capture_output=True, text=True, timeout=120)
    assert (done.returncode, done.stderr) == (0, "")


@pytest.mark.parametrize("encoding", ["ascii", "latin-1"])
def test_help_can_be_printed_in_any_encoding(encoding):
    environment = os.environ | {"PYTHONIOENCODING": encoding}
    done = galton("train", "--help", stdout=subprocess.PIPE, env=environment, encoding=encoding)
    assert done.returncode == 0, done.stderr
    assert "--learning-rate FLOAT" in done.stdout
