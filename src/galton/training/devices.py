"""The cores of this machine as JAX devices."""

import os

import jax


def use_all_cores() -> None:
    """Make JAX see one CPU device per core, each single-threaded, so that `train` spreads runs over all cores.

    To be called before JAX computes anything in this process. Single-threaded kernels also give the same bits
    every time. On a GPU or TPU the call changes nothing that `train` uses.

    Raises:
        RuntimeError: JAX is already running.
    """
    os.environ["NPROC"] = "1"  # the size of XLA's thread pool
    jax.config.update("jax_num_cpu_devices", len(os.sched_getaffinity(0)) if _LINUX else os.cpu_count() or 1)


_LINUX = hasattr(os, "sched_getaffinity")
