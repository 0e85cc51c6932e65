"""The processor cores that this process may use, and JAX on all of them.

Importing this does not import JAX: workers must set its environment first.
"""

import contextlib
import os
import sys
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    import jax


def allowed_cores() -> list[int]:
    """The cores that the operating system lets this process run on, where it tells; else all."""
    if hasattr(os, "sched_getaffinity"):
        return sorted(os.sched_getaffinity(0))
    return list(range(os.cpu_count() or 1))


def n_cores() -> int:
    """The number of cores that this process may use."""
    return len(allowed_cores())


def memory() -> int:
    """The bytes that this process can have at most: the machine's, or less where a limit is set."""
    if os.name != "posix":
        return sys.maxsize
    import resource

    limits = [os.sysconf("SC_PHYS_PAGES") * os.sysconf("SC_PAGE_SIZE"), resource.getrlimit(resource.RLIMIT_AS)[0]]
    with contextlib.suppress(OSError, ValueError):  # a container's, on Linux; it says "max" where there is none
        limits.append(int(Path("/sys/fs/cgroup/memory.max").read_text()))
    return min(limit for limit in limits if limit > 0)


def device_memory(device: "jax.Device") -> int:
    """The bytes that programs on a device of JAX's can have: those of the GPU, where it tells, or the process's."""
    told = device.memory_stats() if device.platform != "cpu" else None
    return int(told["bytes_limit"]) if told and "bytes_limit" in told else memory()


def use_all_cores(runs: int | None = None) -> None:
    """Make JAX see one CPU device per core, each single-threaded, so that `train` spreads runs over all cores.

    To be called before JAX computes anything in this process. Single-threaded kernels also give the same bits
    every time, and small ones, such as one policy's, run without waking another thread. On a GPU or TPU the call
    changes nothing that `train` uses.

    Args:
        runs: how many will be trained at a time. Fewer of them than cores get a device each: with more devices than
            runs, JAX deals the work of one to several threads, which small networks lose by.

    Raises:
        RuntimeError: JAX is already running.
    """
    import jax

    os.environ["NPROC"] = "1"  # the size of XLA's thread pool
    if jax.config.values["jax_num_cpu_devices"] != n_cores():  # else this was called before
        jax.config.update("jax_num_cpu_devices", max(1, min(n_cores(), runs or n_cores())))
    jax.config.update("jax_cpu_enable_async_dispatch", False)
