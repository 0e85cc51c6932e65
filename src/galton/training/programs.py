"""The compiled programs that this process keeps: each maps memory, of which Linux allows only so many pieces.

A process that was forked from this one can run none of them.
"""

import functools
import gc
import os
from collections.abc import Callable
from pathlib import Path
from typing import ParamSpec, TypeVar, cast

import jax

from galton.errors import require

T = TypeVar("T")
P = ParamSpec("P")

_MAPS, _MOST = Path("/proc/self/maps"), Path("/proc/sys/vm/max_map_count")
_KEPT: list[Callable[[], None]] = []
"""The functions that empty the caches of programs, one for each cache."""


def kept(make: Callable[P, T]) -> Callable[P, T]:
    """Keep what a function compiles for each of its arguments; room is made before it compiles something new."""

    @functools.wraps(make)
    def with_room(*args: P.args, **kwargs: P.kwargs) -> T:
        make_room()
        return make(*args, **kwargs)

    cached = functools.lru_cache(maxsize=64)(with_room)
    _KEPT.append(cached.cache_clear)
    return cast("Callable[P, T]", cached)


def make_room(share: float = 0.5) -> None:
    """Forget all programs that nobody holds, where this process maps more than a share of the pieces that it may.

    One piece too many ends a process in the middle of compiling; a program has some hundreds. What is forgotten is
    compiled again where it is needed.
    """
    if not (_MAPS.exists() and _MOST.exists()):
        return  # not Linux
    if _MAPS.read_bytes().count(b"\n") > share * int(_MOST.read_text()):
        for forget in _KEPT:
            forget()
        jax.clear_caches()
        gc.collect()


_first_process = functools.cache(os.getpid)
"""The process in which this is asked first; what is forked from it has the answer already."""


def check_process() -> None:
    """Raise UsageError in a process that was forked after this was called, where JAX waits for threads for ever."""
    require(
        os.getpid() == _first_process(),
        "this process was forked from one that computes with JAX, whose threads are not here, so training would wait "
        'for ever; start it with multiprocessing.get_context("spawn"), or make models only after the fork',
    )
