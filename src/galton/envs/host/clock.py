"""MuJoCo without the clock of its profiler, which its Python package starts and every part of a step reads twice."""

import contextlib
import ctypes
from collections.abc import Iterator
from pathlib import Path

import mujoco


def _clock() -> ctypes.c_void_p:
    """MuJoCo's global `mjcb_time`; a variable of ours where its library does not lie in its package."""
    inside = Path(mujoco.__file__).parent.iterdir()
    for file in (file for file in inside if file.name.startswith(("libmujoco.", "mujoco.dll"))):
        return ctypes.c_void_p.in_dll(ctypes.CDLL(str(file)), "mjcb_time")
    return ctypes.c_void_p()


_CLOCK = _clock()


@contextlib.contextmanager
def unprofiled() -> Iterator[None]:
    """Simulate without filling `MjData.timer`; afterwards the clock is as it was found.

    Nothing else differs. `benchmarks/against_physics.py` says what it saves.
    """
    clock, _CLOCK.value = _CLOCK.value, None
    try:
        yield
    finally:
        if clock:  # without one, another thread has it and puts it back
            _CLOCK.value = clock
