"""Worker processes that may die."""

import multiprocessing
import os
import signal
import subprocess
import sys
import time
from concurrent.futures import Executor
from pathlib import Path

import pytest

from galton.devices import allowed_cores
from galton.errors import UsageError
from galton_experiments.sweep.executors import Place, Processes, WorkerDiedError, one_per_core, one_per_gpu


def where():
    return sorted(os.sched_getaffinity(0)), os.environ.get("CUDA_VISIBLE_DEVICES")


def die_once(path):
    """Killed by its own hand the first time, done the second."""
    if not path.exists():
        path.touch()
        os.kill(os.getpid(), signal.SIGKILL)
    return "done"


def die():
    os._exit(3)


def fail():
    raise UsageError("on purpose")


class TwoPartsError(Exception):
    def __init__(self, one, two):
        super().__init__(f"{one} and {two}")


def fail_in_two_parts():
    raise TwoPartsError("this", "that")


def unpicklable():
    return lambda: None


def nap(seconds):
    time.sleep(seconds)
    return os.getpid()


@pytest.fixture
def two():
    with Processes(one_per_core(2)) as executor:
        yield executor


def test_it_is_an_executor_of_pinned_workers(two):
    assert isinstance(two, Executor)
    cores = allowed_cores()
    answers = [future.result() for future in [two.submit(where) for _ in range(8)]]
    for core, _ in answers:
        assert len(core) == 1
        assert core[0] in cores
    assert list(two.map(abs, [-1, 2])) == [1, 2]


def test_a_worker_per_gpu_sees_its_own(monkeypatch):
    monkeypatch.delenv("CUDA_VISIBLE_DEVICES", raising=False)
    places = one_per_gpu(2)
    assert [dict(place.environment)["CUDA_VISIBLE_DEVICES"] for place in places] == ["0", "1"]
    with Processes(places[1:]) as executor:
        assert executor.submit(where).result()[1] == "1"
    monkeypatch.setenv("CUDA_VISIBLE_DEVICES", "5,7")
    assert [dict(place.environment)["CUDA_VISIBLE_DEVICES"] for place in one_per_gpu(2)] == ["5", "7"]
    with pytest.raises(UsageError, match="gpus is 3, but CUDA_VISIBLE_DEVICES is '5,7'; give 2 at most"):
        one_per_gpu(3)


@pytest.mark.slow
def test_a_worker_that_dies_is_replaced_and_its_call_made_again(two, tmp_path):
    futures = [two.submit(die_once, tmp_path / str(i)) for i in range(5)]
    assert [future.result() for future in futures] == ["done"] * 5


@pytest.mark.slow
def test_a_call_that_kills_every_worker_is_given_up(two, monkeypatch):
    monkeypatch.setattr("galton_experiments.sweep.executors.ATTEMPTS", 2)
    with pytest.raises(WorkerDiedError, match="killed 2 workers"):
        two.submit(die).result()
    assert two.submit(abs, -3).result() == 3


def test_an_exception_comes_back_as_it_was(two):
    with pytest.raises(UsageError, match="on purpose") as told:
        two.submit(fail).result()
    assert 'raise UsageError("on purpose")' in told.value.__notes__[0]
    with pytest.raises(RuntimeError, match=r"TwoPartsError.*this and that"):
        two.submit(fail_in_two_parts).result()
    with pytest.raises(RuntimeError, match="pickle"):
        two.submit(unpicklable).result()
    assert two.submit(abs, -3).result() == 3


def test_calls_that_cant_be_made_are_refused():
    executor = Processes(one_per_core(1))
    with pytest.raises(TypeError, match="give them by position"):
        executor.submit(nap, seconds=1)
    executor.shutdown()
    executor.shutdown(cancel_futures=True)
    with pytest.raises(RuntimeError, match="after a shutdown"):
        executor.submit(nap, 1)


def test_shutting_down_kills_those_at_work():
    before = set(multiprocessing.active_children())
    executor = Processes(one_per_core(2))
    futures = [executor.submit(nap, 60) for _ in range(3)]
    while len(set(multiprocessing.active_children()) - before) < 2:
        time.sleep(0.05)
    start = time.monotonic()
    executor.shutdown(cancel_futures=True)
    assert time.monotonic() - start < 10
    assert set(multiprocessing.active_children()) <= before
    assert all(future.done() for future in futures)
    assert [future.cancelled() for future in futures] == [False, False, True]
    assert all(isinstance(future.exception(), WorkerDiedError) for future in futures[:2])


def test_workers_end_with_a_parent_that_is_killed():
    script = (
        "import multiprocessing, time; from galton_experiments.sweep.executors import Processes, one_per_core\n"
        "if __name__ == '__main__':\n"
        "    executor = Processes(one_per_core(2))\n"
        "    for _ in range(2): executor.submit(time.sleep, 60)\n"
        "    while len(multiprocessing.active_children()) < 2: time.sleep(0.05)\n"
        "    time.sleep(1); print(*(worker.pid for worker in multiprocessing.active_children()), flush=True)\n"
        "    time.sleep(60)"
    )
    with subprocess.Popen([sys.executable, "-c", script], stdout=subprocess.PIPE, text=True) as parent:
        workers = [int(number) for number in parent.stdout.readline().split()]
        parent.kill()
    assert len(workers) == 2
    deadline = time.monotonic() + 10
    while any(alive(worker) for worker in workers):
        assert time.monotonic() < deadline
        time.sleep(0.05)


def alive(process_id):
    try:
        return Path(f"/proc/{process_id}/stat").read_text().rsplit(")", 1)[1].split()[0] != "Z"
    except FileNotFoundError:
        return False


def test_a_number_of_workers_must_be_one_or_more():
    with pytest.raises(UsageError, match="workers is 0"):
        one_per_core(0)
    with pytest.raises(UsageError, match="gpus is -1"):
        one_per_gpu(-1)
    assert len(one_per_core(5)) == 5
    assert {len(place.cores) for place in one_per_core(5)} == {1}
    assert Place() == Place((), ())
