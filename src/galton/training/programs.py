"""The compiled programs that this process keeps: each maps memory, of which Linux allows only so many pieces.

A process that was forked from this one can run none of them.
"""

import functools
import gc
import os
from collections.abc import Callable
from pathlib import Path
from typing import Any, ParamSpec, TypeVar

import jax

from galton.errors import require

T = TypeVar("T")
P = ParamSpec("P")

_MAPS, _MOST = Path("/proc/self/maps"), Path("/proc/sys/vm/max_map_count")
_CONFIG = "jax_enable_x64", "jax_default_matmul_precision", "jax_default_prng_impl"
_KEPT: list[Callable[[], None]] = []
"""The functions that empty the caches of programs, one for each cache."""


def kept(make: Callable[P, T]) -> Callable[P, T]:
    """Keep what a function compiles for each of its arguments, and for each of JAX's settings that programs depend on.

    Room is made before it compiles something new.
    """

    def with_room(_: object, *args: P.args, **kwargs: P.kwargs) -> T:
        make_room()
        return make(*args, **kwargs)

    cached: Any = functools.lru_cache(maxsize=64)(with_room)

    @functools.wraps(make)
    def of_now(*args: P.args, **kwargs: P.kwargs) -> T:
        found: T = cached(tuple(getattr(jax.config, name) for name in _CONFIG), *args, **kwargs)
        return found

    _KEPT.append(cached.cache_clear)
    setattr(of_now, "cache_info", cached.cache_info)  # noqa: B010
    return of_now


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
