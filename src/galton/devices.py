"""The processor cores that this process may use, and JAX on all of them.

Importing this does not import JAX: workers must set its environment first.
"""

import os


def allowed_cores() -> list[int]:
    """The cores that the operating system lets this process run on, where it tells; else all."""
    if hasattr(os, "sched_getaffinity"):
        return sorted(os.sched_getaffinity(0))
    return list(range(os.cpu_count() or 1))


def n_cores() -> int:
    """How many cores this process may use."""
    return len(allowed_cores())


def use_all_cores() -> None:
    """Make JAX see one CPU device per core, each single-threaded, so that `train` spreads runs over all cores.

    To be called before JAX computes anything in this process. Single-threaded kernels also give the same bits
    every time, and small ones, such as one policy's, run without waking another thread. On a GPU or TPU the call
    changes nothing that `train` uses.

    Raises:
        RuntimeError: JAX is already running.
    """
    import jax

    os.environ["NPROC"] = "1"  # the size of XLA's thread pool
    jax.config.update("jax_num_cpu_devices", n_cores())
    jax.config.update("jax_cpu_enable_async_dispatch", False)
