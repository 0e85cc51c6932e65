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
LATE = "time.sleep(0.5)"


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
@pytest.mark.parametrize("busy", [LOOP, LATE], ids=["asked", "at the end"])
def test_one_is_raised_where_the_code_asks_or_at_the_end(busy, number):
    code, out, err = run(DEFERRED.format(busy=busy), number)
    assert (code, out, err) == (5, "ready\nraised\n", "galton: stopping soon\n")


@pytest.mark.parametrize("second", [signal.SIGINT, signal.SIGTERM])
def test_a_second_ends_the_process_even_in_compiled_code_that_takes_minutes(second):
    code, out, err = run(DEFERRED.format(busy=BUSY), signal.SIGINT, second)
    assert (code, out, err) == (130, "ready\n", "galton: stopping soon\ngalton: interrupted again\n")


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


@pytest.mark.parametrize("busy", [BUSY, "import time; time.sleep(30)"], ids=["compiled", "asleep"])
def test_where_nothing_can_be_lost_one_is_enough(busy):
    code = f"""
from galton.cli._interrupts import leaving_at_once
with leaving_at_once("interrupted; nothing was written"):
    print("ready", flush=True)
    {busy}
"""
    assert run(code, signal.SIGINT) == (130, "ready\n", "galton: interrupted; nothing was written\n")


def test_it_goes_on_without_a_standard_error():
    code = "import sys; sys.stderr.close()\n" + DEFERRED.format(busy=LOOP)
    assert run(code, signal.SIGINT)[0] == 5
