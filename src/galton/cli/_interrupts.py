"""Ctrl-C and SIGTERM end a command in an orderly way.

Python raises KeyboardInterrupt wherever the main thread is. Compiled code, such as that of JAX's compiler or of an
import, crashes or swallows it, so here a thread of its own is told of interrupts.
"""

import contextlib
import os
import signal
import socket
import sys
import threading
from collections.abc import Callable, Iterator

ASKING = [getattr(signal, name) for name in ("SIGINT", "SIGTERM", "SIGHUP") if hasattr(signal, name)]
"""The signals that ask a process to end: Ctrl-C, a batch system's, a terminal's that is closed."""

EXIT_CODE = 130
"""The exit code that a shell shows for a command that Ctrl-C ended."""


@contextlib.contextmanager
def leaving_at_once(told: str) -> Iterator[None]:
    """A time in which nothing can be lost: an interrupt ends the process with these words."""
    with _watching(lambda _: _leave(told)):
        yield


@contextlib.contextmanager
def deferred(told: str, at_first: Callable[[], None] | None = None) -> Iterator[Callable[[], None]]:
    """A function that raises KeyboardInterrupt if the user asked to stop since.

    The first interrupt is answered with these words, and has `at_first` called in a thread of its own; the second ends
    the process at once.
    """
    asked = threading.Event()

    def act(n: int) -> None:
        if n > 1:
            _leave("interrupted again")
        asked.set()
        _say(told)
        if at_first:
            threading.Thread(target=at_first, daemon=True).start()

    def check() -> None:
        if asked.is_set():
            raise KeyboardInterrupt

    with _watching(act):
        yield check


@contextlib.contextmanager
def _watching(act: Callable[[int], None]) -> Iterator[None]:
    """A time in which a thread calls `act(n)` at the n-th interrupt, whatever the main thread is doing.

    One that is ignored, as Ctrl-C is by what a script runs in the background, stays so.
    """
    reader, writer = socket.socketpair()
    writer.setblocking(False)

    def watch() -> None:
        n = 0
        while number := reader.recv(1):  # of any signal that Python handles
            if number[0] in heard:
                n += 1
                act(n)
        reader.close()

    heard = [number for number in ASKING if signal.getsignal(number) != signal.SIG_IGN]
    threading.Thread(target=watch, daemon=True).start()
    previous = {number: signal.signal(number, lambda *_: None) for number in heard}
    outer = signal.set_wakeup_fd(writer.fileno(), warn_on_full_buffer=False)
    try:
        yield
    finally:
        signal.set_wakeup_fd(outer)
        for number, handler in previous.items():
            signal.signal(number, handler)
        writer.close()


def _leave(told: str) -> None:
    _say(told)
    with contextlib.suppress(OSError, ValueError, AttributeError):
        if sys.stdout.isatty():  # a progress bar hides the cursor
            os.write(sys.stdout.fileno(), b"\x1b[?25h")
    os._exit(EXIT_CODE)


def _say(told: str) -> None:
    with contextlib.suppress(OSError, ValueError):  # standard error may be gone
        print(f"galton: {told}", file=sys.stderr, flush=True)
