"""The cores of this machine as JAX devices."""

import os

import jax

from galton.cores import n_cores


def use_all_cores() -> None:
    """Make JAX see one CPU device per core, each single-threaded, so that `train` spreads runs over all cores.

    To be called before JAX computes anything in this process. Single-threaded kernels also give the same bits
    every time, and small ones, such as one policy's, run without waking another thread. On a GPU or TPU the call
    changes nothing that `train` uses.

    Raises:
        RuntimeError: JAX is already running.
    """
    os.environ["NPROC"] = "1"  # the size of XLA's thread pool
    jax.config.update("jax_num_cpu_devices", n_cores())
    jax.config.update("jax_cpu_enable_async_dispatch", False)
