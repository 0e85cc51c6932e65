"""Shapes and types are checked at every call of every galton function; and no process keeps too many programs."""

import gc
from pathlib import Path

import jax
import pytest
from jaxtyping import install_import_hook

install_import_hook("galton", "beartype.beartype")

import galton  # noqa: E402
from galton.training import host_programs, on_device  # noqa: E402

galton.use_all_cores()

_MAPS = Path("/proc/self/maps")
_MOST = 15_000
"""Linux lets a process map 65,530 pieces of memory; each compiled program keeps some, and one too many ends it."""


@pytest.fixture(autouse=True, scope="module")
def few_programs():
    """Forget what was compiled for a module of tests where there is much of it."""
    yield
    if _MAPS.exists() and _MAPS.read_bytes().count(b"\n") > _MOST:
        for programs in (on_device._compile, on_device._compile_evaluation, host_programs.host_programs):
            programs.cache_clear()
        jax.clear_caches()
        gc.collect()
