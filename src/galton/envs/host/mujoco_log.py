"""What MuJoCo says while an environment is made: as Python's warnings, and not in a MUJOCO_LOG.TXT."""

import contextlib
import sys
import threading
import warnings
from collections.abc import Iterator

_OF_GYMNASIUM = "compiler attribute 'settotalmass' is deprecated"
"""What Gymnasium's own HalfCheetah is told at each making; its users can do nothing about it."""
_lock = threading.RLock()


@contextlib.contextmanager
def mujoco_warns() -> Iterator[None]:
    """Turn MuJoCo's messages into warnings; nothing happens without MuJoCo, or where the user handles them already."""
    mujoco = sys.modules.get("mujoco")
    if mujoco is None or mujoco.get_mju_user_warning():
        yield
        return
    told: list[str] = []
    with _lock:
        mujoco.set_mju_user_warning(told.append)  # C code, since an exception of Python's would end the process
        try:
            yield
        finally:
            mujoco.set_mju_user_warning(None)
    for message in told:
        if not message.startswith(_OF_GYMNASIUM):
            warnings.warn(f"MuJoCo: {message}", stacklevel=4)
