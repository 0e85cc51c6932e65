"""No process keeps too many programs; with CHECKED shapes and types are checked at every call of every function."""

import collections
import functools
import os
import signal

import hypothesis
import jax
import jaxtyping
import numpy as np
import pytest
from jaxtyping import install_import_hook

if os.environ.get("CHECKED"):  # make test-types
    jaxtyping.Array = jaxtyping.Array | np.ndarray  # functions of JAX take NumPy's arrays too
    checker = "beartype.beartype(conf=beartype.BeartypeConf(is_pep484_tower=True))"  # an int is a float
    install_import_hook(["galton", "galton_experiments", "studies"], checker)

import galton
from galton.training.programs import make_room
from tests.trust import FOLDER, note

galton.use_all_cores()
signal.signal(signal.SIGINT, signal.default_int_handler)  # a shell's background job ignores it
# A busy machine is no failure. `make test` tries the same cases each time, and `make test-all` looks for new ones.
hypothesis.settings.register_profile("same", deadline=None, derandomize=True)
hypothesis.settings.register_profile("new", deadline=None)
hypothesis.settings.load_profile(os.environ.get("CASES", "same"))


@pytest.hookimpl(tryfirst=True)
def pytest_collection_modifyitems(config, items):
    """Of `few` cases the first alone is fast. Where measurements are asked for, only tests that take some run."""
    begun = set()
    for item in items:
        if item.get_closest_marker("few"):
            name = item.nodeid.partition("[")[0]
            if name in begun:
                item.add_marker(pytest.mark.slow)
            begun.add(name)
    if FOLDER:
        others = [item for item in items if "trust" not in item.fixturenames]
        items[:] = [item for item in items if "trust" in item.fixturenames]
        config.hook.pytest_deselected(items=others)


def pytest_terminal_summary(terminalreporter):
    """Tell which files took longest: a file is what one process takes, so the longest decide how long all take."""
    seconds = collections.Counter()
    for reports in terminalreporter.stats.values():
        for report in reports:
            if hasattr(report, "duration"):
                seconds[report.nodeid.partition("::")[0]] += report.duration
    if sum(seconds.values()) > 60:
        terminalreporter.section(f"slowest of {len(seconds)} files, {sum(seconds.values()):,.0f} seconds in all")
        for file, taken in seconds.most_common(30):
            terminalreporter.write_line(f"{taken:7.1f} s {file}")


@pytest.fixture
def trust(request):
    """What a test calls in the end with what it measured of a promise: see `tests/trust.py`."""
    return functools.partial(note, FOLDER, request.node.nodeid)


@pytest.fixture
def double():
    """JAX counts in float64."""
    with jax.enable_x64(True):
        yield


@pytest.fixture(autouse=True, scope="module")
def few_programs():
    """Forget what was compiled for a module of tests where there is much of it: tests compile much of their own."""
    yield
    make_room(0.25)


@pytest.fixture(autouse=True)
def room_for_programs(request):
    """The same after a slow test: those of one module can compile more than a process may map, which ends it."""
    yield
    if request.node.get_closest_marker("slow") or request.node.get_closest_marker("optimised"):
        make_room(0.5)
