"""MuJoCo's messages while an environment is made come as Python's warnings, and not in a MUJOCO_LOG.TXT."""

import contextlib
import importlib
import sys
import threading
import warnings
from collections.abc import Callable, Iterator

_OF_GYMNASIUM = "compiler attribute 'settotalmass' is deprecated"
"""The message that MuJoCo has for Gymnasium's own HalfCheetah at each making; its users can do nothing about it."""
_lock = threading.RLock()


@contextlib.contextmanager
def mujoco_warns() -> Iterator[None]:
    """Turn MuJoCo's messages into warnings; nothing happens without MuJoCo, or where the user handles them already."""
    told: list[str] = []
    with _lock if "mujoco" in sys.modules else contextlib.nullcontext(), _heard(told.append):
        yield
    for message in told:
        if not message.startswith(_OF_GYMNASIUM):
            warnings.warn(f"MuJoCo: {message}", stacklevel=4)


@contextlib.contextmanager
def _heard(hear: Callable[[str], None]) -> Iterator[None]:
    """Have MuJoCo tell a function, of C since an exception of Python's would end the process."""
    first = _First(hear)
    if "mujoco" in sys.modules:
        first.listen()
    else:
        sys.meta_path.insert(0, first)
    try:
        yield
    finally:
        with contextlib.suppress(ValueError):
            sys.meta_path.remove(first)
        mujoco = sys.modules.get("mujoco")
        if mujoco is not None and mujoco.get_mju_user_warning() == hear:
            mujoco.set_mju_user_warning(None)


class _First:
    """Listens to MuJoCo before Gymnasium's environments import it; it is in the place of what finds modules."""

    def __init__(self, hear: Callable[[str], None]) -> None:
        self._hear = hear

    def find_spec(self, name: str, path: object = None, target: object = None) -> None:
        """Find nothing, but be called before this module is imported."""
        if name == "gymnasium.envs.mujoco":
            with contextlib.suppress(Exception):  # it is not there, or can't be loaded, which Gymnasium tells
                importlib.import_module("mujoco")
                self.listen()

    def listen(self) -> None:
        """Have MuJoCo tell what it has to say, unless the user does."""
        mujoco = sys.modules["mujoco"]
        if mujoco is not None and not mujoco.get_mju_user_warning():
            mujoco.set_mju_user_warning(self._hear)
