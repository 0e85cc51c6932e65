"""N MuJoCo simulations of one model: in `mujoco.batch`, or in a loop where a task needs what that doesn't compute."""

import contextlib
import ctypes
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import mujoco
import numpy as np
from jaxtyping import Float, Int
from mujoco.batch import Batch

Fields = dict[str, Float[np.ndarray, "N ..."]]
"""Fields of MjData by name."""

STATE = mujoco.mjtState.mjSTATE_INTEGRATION
UNSTABLE = [int(getattr(mujoco.mjtWarning, f"mjWARN_BAD{name}")) for name in ("QPOS", "QVEL", "QACC")]
"""The warnings after which MuJoCo resets a simulation without a word."""


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

    MuJoCo's Python package starts the clock, and every part of a step reads it twice. Nothing else differs.
    `benchmarks/against_physics.py` says what it saves.
    """
    clock, _CLOCK.value = _CLOCK.value, None
    try:
        yield
    finally:
        if clock:  # without one, another thread has it and puts it back
            _CLOCK.value = clock


class Batched:
    """`mujoco.batch`; fields that Gymnasium computes after the step, such as cfrc_ext, are out of its reach."""

    def __init__(self, model: mujoco.MjModel, n: int, n_threads: int, fields: tuple[str, ...]) -> None:
        self._batch = Batch(model, n, n_threads)
        live = {name: self._batch.bind(name) for name in fields}
        self._derived = [name for name in fields if not live[name].flags.writeable]
        # What MuJoCo derives is copied, so that set_state can put it back.
        self.fields = {name: live[name].copy() if name in self._derived else live[name] for name in fields}
        self._live, self._control = live, self._batch.bind("ctrl")
        self.was_reset = np.zeros(n, bool)
        """True for each simulation that MuJoCo reset in the last step because it was unstable."""

    def step(self, control: Float[np.ndarray, "N u"], n_substeps: int) -> None:
        """Take that many substeps under constant controls."""
        self._control[:] = control
        with unprofiled():
            self._batch.step(nstep=n_substeps)
        self._refresh()
        self.was_reset = self._batch.warning[:, UNSTABLE, 1].any(1)

    def reset(self, ids: Int[np.ndarray, " n"], qpos: Float[np.ndarray, "n q"], qvel: Float[np.ndarray, "n v"]) -> None:
        """Start these simulations again from the given positions and velocities."""
        self._batch.reset(ids, stage=mujoco.mjtStage.mjSTAGE_NONE.value)
        self._batch.bind("qpos")[ids], self._batch.bind("qvel")[ids] = qpos, qvel
        self._batch.forward(ids)
        self._refresh()

    def get_state(self) -> Float[np.ndarray, "N state"]:
        """The state of each simulation that integration goes on from."""
        return np.array(self._batch.state)

    def set_state(self, physics: Float[np.ndarray, "N state"], fields: dict[str, np.ndarray]) -> None:
        """Go on from a state, with the fields that were computed on the way to it."""
        self._batch.state[:] = physics
        for name in self._derived:
            self.fields[name][:] = fields[name]

    def close(self) -> None:
        """Do nothing: no thread outlives the batch."""

    def _refresh(self) -> None:
        for name in self._derived:
            self.fields[name][:] = self._live[name]


class Looped:
    """One MjData each, in a loop per thread (MuJoCo lets go of the interpreter), with mj_rnePostConstraint after it."""

    def __init__(self, model: mujoco.MjModel, n: int, n_threads: int, fields: tuple[str, ...]) -> None:
        self._model = model
        self._data = [mujoco.MjData(model) for _ in range(n)]
        self.fields = {name: np.array([getattr(data, name) for data in self._data]) for name in fields}
        self._parts = [part for part in np.array_split(np.arange(n), n_threads) if len(part)]
        self._pool = ThreadPoolExecutor(len(self._parts)) if len(self._parts) > 1 else None
        self.was_reset = np.zeros(n, bool)

    def step(self, control: Float[np.ndarray, "N u"], n_substeps: int) -> None:
        """Take that many substeps under constant controls."""

        def work(part: np.ndarray) -> None:
            for i in part.tolist():
                data = self._data[i]
                data.ctrl[:] = control[i]
                mujoco.mj_step(self._model, data, nstep=n_substeps)
                mujoco.mj_rnePostConstraint(self._model, data)
                self._read(i)
                self.was_reset[i] = any(data.warning[kind].number for kind in UNSTABLE)

        with unprofiled():
            list(self._pool.map(work, self._parts)) if self._pool else work(self._parts[0])

    def reset(self, ids: Int[np.ndarray, " n"], qpos: Float[np.ndarray, "n q"], qvel: Float[np.ndarray, "n v"]) -> None:
        """Start these simulations again from the given positions and velocities."""
        for i, q, v in zip(ids.tolist(), qpos, qvel, strict=True):
            data = self._data[i]
            mujoco.mj_resetData(self._model, data)
            data.qpos[:], data.qvel[:] = q, v
            mujoco.mj_forward(self._model, data)
            self._read(i)

    def get_state(self) -> Float[np.ndarray, "N state"]:
        """The state of each simulation that integration goes on from."""
        rows = np.empty((len(self._data), mujoco.mj_stateSize(self._model, STATE)))
        for row, data in zip(rows, self._data, strict=True):
            mujoco.mj_getState(self._model, data, row, STATE)
        return rows

    def set_state(self, physics: Float[np.ndarray, "N state"], fields: dict[str, np.ndarray]) -> None:
        """Go on from a state, with the fields that were computed on the way to it."""
        for row, data in zip(physics, self._data, strict=True):
            mujoco.mj_resetData(self._model, data)
            mujoco.mj_setState(self._model, data, row, STATE)
        for name in self.fields:
            self.fields[name][:] = fields[name]

    def close(self) -> None:
        """End the threads that stepped the simulations."""
        if self._pool:
            self._pool.shutdown()

    def _read(self, i: int) -> None:
        for name, values in self.fields.items():
            values[i] = getattr(self._data[i], name)


Simulations = Batched | Looped
"""N simulations, each with its own state."""
