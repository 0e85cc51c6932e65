"""Worker processes that may die, as an Executor of concurrent.futures."""

import contextlib
import copy
import multiprocessing
import multiprocessing.connection
import multiprocessing.context
import os
import queue
import signal
import threading
import traceback
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import Executor, Future
from typing import Any, NamedTuple, TypeAlias, TypeVar

from galton.devices import allowed_cores
from galton.errors import require, require_integer

T = TypeVar("T")
Call = tuple[Future[Any], Callable[..., object], tuple[object, ...]]
"""The call that a worker is to make: the future of it, a function and its arguments."""
Pipe: TypeAlias = "multiprocessing.connection.Connection[object, Any]"
"""One end of the pipe between this process and a worker."""

ATTEMPTS = 20
"""The most attempts at a call whose process dies each time."""


class Place(NamedTuple):
    """A worker's place is its cores, and what its environment has besides."""

    cores: tuple[int, ...] = ()
    """The cores that it is kept on, where the operating system can; () leaves it free."""
    environment: tuple[tuple[str, str], ...] = ()
    """Variables of the environment that it sees, besides those of this process."""


def one_per_core(n: int | None = None) -> list[Place]:
    """As many workers as there are cores, or n, dealt to the cores in turn."""
    cores = allowed_cores()
    n = len(cores) if n is None else n
    require_integer("workers", n, 1)
    return [Place((cores[i % len(cores)],)) for i in range(n)]


def one_per_gpu(n: int) -> list[Place]:
    """A worker for each of n CUDA devices, of those that this process may use, each with its share of the cores."""
    require_integer("gpus", n, 1)
    cores, given = allowed_cores(), os.environ.get("CUDA_VISIBLE_DEVICES")
    devices = [str(i) for i in range(n)] if given is None else given.split(",") if given else []
    require(len(devices) >= n, f"gpus is {n}, but CUDA_VISIBLE_DEVICES is {given!r}; give {len(devices)} at most")
    return [Place(tuple(cores[i::n]), (("CUDA_VISIBLE_DEVICES", devices[i]),)) for i in range(n)]


class WorkerDiedError(RuntimeError):
    """A future raises this if every process that made its call died."""


class Processes(Executor):
    """A process for each place. One that dies is replaced, and its call is made again."""

    def __init__(self, places: Sequence[Place]) -> None:
        self._calls: queue.SimpleQueue[Call | None] = queue.SimpleQueue()
        self._context = multiprocessing.get_context("spawn")
        self._workers: dict[int, multiprocessing.context.SpawnProcess] = {}
        self._lock, self._closed, self._shut = threading.Lock(), threading.Event(), False
        self._threads = [
            threading.Thread(target=self._serve, args=(i, place), daemon=True) for i, place in enumerate(places)
        ]
        for thread in self._threads:
            thread.start()

    def submit(self, fn: Callable[..., T], /, *args: object, **kwargs: object) -> Future[T]:
        """Call fn, which a worker must be able to import, with arguments that can be pickled.

        Raises:
            RuntimeError: after a shutdown.
            TypeError: keyword arguments.
        """
        if kwargs:
            raise TypeError(f"keyword arguments {sorted(kwargs)} are not sent to workers; give them by position")
        if self._shut:
            raise RuntimeError("no calls can be made after a shutdown")
        future: Future[T] = Future()
        self._calls.put((future, fn, args))
        return future

    def shutdown(self, wait: bool = True, *, cancel_futures: bool = False) -> None:
        """Let the workers go; those that are not idle are killed if cancel_futures."""
        if cancel_futures:
            with self._lock:
                self._closed.set()
                for worker in self._workers.values():
                    worker.kill()
            with contextlib.suppress(queue.Empty):
                while True:
                    if call := self._calls.get_nowait():
                        call[0].cancel()
                    else:
                        self._calls.put(None)
                        break
        if not self._shut:
            self._shut = True
            for _ in self._threads:
                self._calls.put(None)
        if wait:
            for thread in self._threads:
                thread.join()

    def _serve(self, number: int, place: Place) -> None:
        connection: Pipe | None = None
        while (call := self._calls.get()) is not None:
            future, fn, args = call
            if self._closed.is_set():
                future.cancel()
            if not future.set_running_or_notify_cancel():
                continue
            last: Exception | None = None
            for _ in range(ATTEMPTS):
                try:
                    connection = connection or self._start(number, place)
                    connection.send((fn, args))
                    value, error = connection.recv()
                except (EOFError, OSError) as end:  # it died, or could not be started
                    connection, last = None, end
                    if self._closed.is_set():
                        error = WorkerDiedError("stopped")
                        break
                except Exception as unreadable:
                    error = unreadable
                    break
                else:
                    break
            else:
                error = WorkerDiedError(f"{fn.__name__}{args} killed {ATTEMPTS} workers one after the other: {last!r}")
            if error is None:
                future.set_result(value)
            else:
                future.set_exception(error)
        if connection:
            connection.close()
        with self._lock:
            worker = self._workers.pop(number, None)
        if worker:
            worker.join()

    def _start(self, number: int, place: Place) -> Pipe:
        ours, its = self._context.Pipe()
        with self._lock:
            if self._closed.is_set():
                raise EOFError
            worker = self._context.Process(target=_live, args=(its, place), daemon=True)
            worker.start()
            self._workers[number] = worker
        its.close()
        return ours


@contextlib.contextmanager
def processes(places: Sequence[Place]) -> Iterator[Processes]:
    """An executor with a process for each place; what still works when the block ends is killed."""
    executor = Processes(places)
    try:
        yield executor
    finally:
        executor.shutdown(cancel_futures=True)


def _live(connection: Pipe, place: Place) -> None:
    """A worker's life: calls, until there are no more. It ends with its parent, however that ends."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # the parent says when to stop
    threading.Thread(target=_end_with_parent, daemon=True).start()
    if place.cores and hasattr(os, "sched_setaffinity"):
        os.sched_setaffinity(0, place.cores)
    os.environ.update(place.environment)
    while True:
        try:
            fn, args = connection.recv()
        except EOFError:
            return
        answer: tuple[object, Exception | None]
        try:
            answer = fn(*args), None
        except Exception as error:
            error.add_note(traceback.format_exc())  # which is not sent
            answer = None, error
        try:
            copy.copy(answer[1])
            connection.send(answer)
        except OSError:
            return
        except Exception as error:  # what can't be pickled, or made again
            failed = answer[1] or error
            told = RuntimeError(repr(failed))
            for note in getattr(failed, "__notes__", ()):
                told.add_note(note)
            connection.send((None, told))


def _end_with_parent() -> None:
    parent = multiprocessing.parent_process()
    assert parent
    parent.join()
    os._exit(1)
