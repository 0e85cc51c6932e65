"""The clock of MuJoCo's profiler: off while we simulate, and afterwards as it was."""

import contextlib

import gymnasium
import mujoco
import numpy as np
import pytest

from galton.envs import find
from galton.envs.host import clock
from galton.envs.host.clock import unprofiled

STEP = mujoco.mjtTimer.mjTIMER_STEP


def seconds_of_a_step():
    """What MuJoCo's own profiler says of a step of its own."""
    simulated = gymnasium.make("Reacher-v5").unwrapped
    mujoco.mj_step(simulated.model, simulated.data)
    return simulated.data.timer[STEP].duration


@pytest.mark.parametrize("name", ["Reacher-v5", "Ant-v5"])  # in mujoco.batch, and in a loop
def test_a_profile_is_filled_again_once_we_have_simulated(name):
    assert seconds_of_a_step() > 0
    envs = find(name).make(4, 2)
    envs.reset(np.arange(4))
    envs.step(np.zeros((4, envs._actions.low.size), np.float32))
    envs.close()
    assert seconds_of_a_step() > 0


def test_no_profile_is_filled_within_and_a_clock_comes_back_after_an_error():
    with contextlib.suppress(ValueError), unprofiled():
        assert seconds_of_a_step() == 0
        with unprofiled():
            assert seconds_of_a_step() == 0
        assert seconds_of_a_step() == 0  # the outer one puts it back
        raise ValueError("of the test")
    assert seconds_of_a_step() > 0


def test_a_clock_of_the_users_own_is_put_back():
    mujoco.set_mjcb_time(lambda: 1.0)
    try:
        with unprofiled():
            seconds_of_a_step()
        assert mujoco.get_mjcb_time()() == 1.0
    finally:
        mujoco.set_mjcb_time(None)
    assert seconds_of_a_step() > 0


def test_without_the_library_in_its_package_nothing_is_changed(tmp_path, monkeypatch):
    monkeypatch.setattr(mujoco, "__file__", str(tmp_path / "__init__.py"))
    monkeypatch.setattr(clock, "_CLOCK", clock._clock())
    with unprofiled():
        assert seconds_of_a_step() > 0
