"""Ctrl-C, one and two, whatever compiled code the main thread is in."""

import signal
import subprocess
import sys
import time

import pytest

BUSY = "import hashlib; hashlib.pbkdf2_hmac('sha256', b'', b'', 10**9)"  # minutes, and Python's handlers wait for it
DEFERRED = """
import sys, time
from galton.cli._interrupts import deferred
try:
    with deferred("stopping soon") as check:
        print("ready", flush=True)
        {busy}
except KeyboardInterrupt:
    print("raised", flush=True)
    sys.exit(5)
"""
LOOP = "[(time.sleep(0.01), check()) for _ in range(3000)]"


def run(code, *signals):
    """The exit code and output of a process that is sent signals, each 0.3 s after the one before."""
    process = subprocess.Popen([sys.executable, "-c", code], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
    first = process.stdout.readline()
    for number in signals:
        time.sleep(0.3)
        process.send_signal(number)
    out, err = process.communicate(timeout=60)
    return process.returncode, first + out, err


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_one_is_raised_where_the_code_asks(number):
    assert run(DEFERRED.format(busy=LOOP), number) == (5, "ready\nraised\n", "galton: stopping soon\n")
    silent = "import sys; sys.stderr.close()\n" + DEFERRED.format(busy=LOOP)
    assert number == signal.SIGTERM or run(silent, number)[0] == 5, "it goes on without a standard error"


def test_one_that_comes_when_the_work_is_done_takes_nothing_back():
    done = run(DEFERRED.format(busy="time.sleep(0.5)"), signal.SIGINT)
    assert done == (0, "ready\n", "galton: stopping soon\n")


@pytest.mark.parametrize(("number", "handler"), [("SIGUSR1", "lambda *_: None"), ("SIGINT", "signal.SIG_IGN")])
def test_other_signals_that_python_handles_and_those_that_are_ignored_are_none(number, handler):
    code = f"import signal; signal.signal(signal.{number}, {handler})\n" + DEFERRED
    busy = "[(time.sleep(0.01), check()) for _ in range(100)]"
    sent = getattr(signal, number)
    assert run(code.format(busy=busy), sent, sent) == (0, "ready\n", "")


@pytest.mark.few
@pytest.mark.parametrize("second", [signal.SIGINT, signal.SIGTERM])
def test_a_second_ends_the_process_even_in_compiled_code_that_takes_minutes(second):
    done = run(DEFERRED.format(busy=BUSY), signal.SIGINT, second)
    assert done == (130, "ready\n", "galton: stopping soon\ngalton: interrupted again\n")


def test_none_changes_nothing_and_the_handlers_are_as_before():
    code = """
import signal
from galton.cli._interrupts import deferred, leaving_at_once
before = signal.getsignal(signal.SIGINT), signal.set_wakeup_fd(-1)
with deferred("a"), leaving_at_once("b"):
    pass
with deferred("a") as check:
    check()
assert before == (signal.getsignal(signal.SIGINT), signal.set_wakeup_fd(-1))
print("done")
"""
    assert run(code) == (0, "done\n", "")


@pytest.mark.few
@pytest.mark.parametrize("busy", [BUSY, "import time; time.sleep(30)"], ids=["compiled", "asleep"])
def test_where_nothing_can_be_lost_one_is_enough(busy):
    code = f"""
from galton.cli._interrupts import leaving_at_once
with leaving_at_once("interrupted; nothing was written"):
    print("ready", flush=True)
    {busy}
"""
    assert run(code, signal.SIGINT) == (130, "ready\n", "galton: interrupted; nothing was written\n")


LEARNING = """
import sys, time
import galton
galton.use_all_cores()
model = galton.A2C("lqr", "hl-gauss", n_bins=10, net_arch=(8,))
model.learn(2_000, progress_bar=False)
print("ready", flush=True)
for _ in range(2):
    try:
        model.learn(10**9, progress_bar=False)
    except KeyboardInterrupt:
        step = model.num_timesteps
        assert galton.A2C.load(model.save(sys.argv[1]), "lqr").num_timesteps == step > 2_000
print("saved", flush=True)
"""


@pytest.mark.slow
def test_learning_in_a_script_of_ones_own_that_is_interrupted_can_be_saved_and_goes_on(tmp_path):
    code = LEARNING.replace("sys.argv[1]", repr(str(tmp_path / "model")))
    process = subprocess.Popen([sys.executable, "-c", code], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
    assert process.stdout.readline() == "ready\n"
    for _ in range(2):
        time.sleep(3)
        process.send_signal(signal.SIGINT)
    out, err = process.communicate(timeout=120)
    assert (process.returncode, out) == (0, "saved\n"), err
