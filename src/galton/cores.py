"""How many processor cores this process may use."""

import os


def n_cores() -> int:
    """Those that the operating system lets it run on, where it tells; else all."""
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1
