"""The processor cores that this process may use."""

import os


def allowed_cores() -> list[int]:
    """Those that the operating system lets it run on, where it tells; else all."""
    if hasattr(os, "sched_getaffinity"):
        return sorted(os.sched_getaffinity(0))
    return list(range(os.cpu_count() or 1))


def n_cores() -> int:
    """How many those are."""
    return len(allowed_cores())
