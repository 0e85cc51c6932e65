"""MuJoCo's messages become warnings or nothing; no MUJOCO_LOG.TXT lies about."""

import subprocess
import sys
import warnings

import gymnasium
import numpy as np
import pytest
from gymnasium.spaces import Box

from galton import UsageError
from galton.envs.find import find

mujoco = pytest.importorskip("mujoco")

DEPRECATED = (
    '<mujoco><compiler settotalmass="1"/><worldbody><body><freejoint/><geom size="1"/></body></worldbody></mujoco>'
)


class Model(gymnasium.Env):
    """Compiles a model of MuJoCo's when it is made."""

    action_space = Box(-1, 1, (1,))
    observation_space = Box(-1, 1, (1,))

    def __init__(self, xml=DEPRECATED):
        self.model = mujoco.MjModel.from_xml_string(xml)

    def reset(self, *, seed=None, options=None):
        super().reset(seed=seed)
        return np.zeros(1, np.float32), {}


@pytest.mark.parametrize(
    "env",
    ["HalfCheetah-v5", lambda: gymnasium.make("HalfCheetah-v5"), Model],
    ids=["ours", "Gymnasium's", "the user's"],
)
def test_making_an_environment_leaves_no_line_and_no_file(env, tmp_path, monkeypatch, capfd):
    monkeypatch.chdir(tmp_path)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        find(env).make(2).close()
    assert list(tmp_path.iterdir()) == []
    assert capfd.readouterr() == ("", "")
    assert mujoco.get_mju_user_warning() is None


@pytest.mark.slow
def test_a_function_that_is_the_first_to_import_mujoco_leaves_no_line_either(tmp_path):
    code = "import gymnasium; from galton.envs.find import find; find(lambda: gymnasium.make('HalfCheetah-v5'))"
    done = subprocess.run([sys.executable, "-c", code], cwd=tmp_path, capture_output=True, text=True)
    assert (done.returncode, done.stdout, done.stderr, [*tmp_path.iterdir()]) == (0, "", "", [])


def test_what_the_users_own_model_is_told_is_a_warning(tmp_path, monkeypatch):
    class Unstable(Model):
        def __init__(self):
            super().__init__()
            data = mujoco.MjData(self.model)
            data.qvel[:] = 1e30
            mujoco.mj_step(self.model, data)

    monkeypatch.chdir(tmp_path)
    with pytest.warns(UserWarning, match=r"MuJoCo: Nan, Inf or huge value in QVEL"):
        find(Unstable)
    assert list(tmp_path.iterdir()) == []


def test_a_handler_of_the_users_own_is_left_in_its_place():
    told = []
    handler = told.append
    mujoco.set_mju_user_warning(handler)
    try:
        find(Model)
        assert mujoco.get_mju_user_warning() == handler
    finally:
        mujoco.set_mju_user_warning(None)
    assert ["settotalmass" in message for message in told] == [True]
    with pytest.raises(UsageError, match="can't be made: ValueError"):
        find(lambda: Model("<mujoco><nonsense/></mujoco>"))
    assert mujoco.get_mju_user_warning() is None
