import json
import subprocess
import sys
import warnings
from pathlib import Path

import numpy as np
import pytest

from galton import A2C, LOSSES, InexactResume, UsageError
from galton.envs import LQR
from galton.saving import checkpoint

from . import swing

HERE = Path(__file__).parent
CHILD = f"""
import json, pathlib, sys
import galton
galton.use_all_cores()
sys.path.insert(0, {str(HERE)!r})
import swing
for env, path, steps in json.loads(sys.argv[1]):
    env = getattr(swing, env, env)
    model, logs = galton.A2C.load(path, env=env), []
    model.learn(steps, lambda model, log: logs.append(log), progress_bar=False, log_interval=5)
    model.save(path + ".end")
    pathlib.Path(path + ".logs").write_text(json.dumps(logs))
    model.close()
"""
SETTINGS = {
    "n_bins": 10,
    "net_arch": (8,),
    "n_steps": 4,
    "n_envs": 2,
    "learning_rate": 1e-2,
    "normalize_observation": True,
    "normalize_reward": True,
}
SIZE = 8
BEFORE, AFTER = 7 * SIZE, 8 * SIZE
"""Updates on both sides of the cut, which lies in the middle of a log interval of 5."""


def train(env, loss, path):
    """A run without a cut that is also saved at the cut: its logs and its file."""
    logs = []
    model = A2C(getattr(swing, env, env), loss, **SETTINGS, seed=5)
    learn = {"callback": lambda model, log: logs.append(log), "progress_bar": False, "log_interval": 5}
    model.learn(BEFORE, **learn)
    assert len(logs) == 2  # after 5 updates and at the end
    model.save(path)
    model.learn(AFTER, **learn)
    whole = model.save(path.with_suffix(".whole"))
    model.close()
    return logs[2:], whole


def known(logs):
    return [{key: value for key, value in log.items() if not key.startswith(("time/time", "time/fps"))} for log in logs]


def check_a_new_process_goes_on_exactly(env, losses, folder):
    """Fail unless a new process goes on as this one does; how many bytes of the models differ."""
    paths = [folder / f"{loss}.cut" for loss in losses]
    runs = [train(env, loss, path) for loss, path in zip(losses, paths, strict=True)]
    jobs = json.dumps([(env, str(path), AFTER) for path in paths])
    subprocess.run([sys.executable, "-W", "error", "-c", CHILD, jobs], check=True)
    for path, (logs, whole) in zip(paths, runs, strict=True):
        theirs = json.loads(Path(f"{path}.logs").read_text())
        assert json.dumps(known(theirs)) == json.dumps(known(logs))
        assert len(theirs) == 2
        (settings, arrays), (other_settings, others) = map(checkpoint.read, (whole, Path(f"{path}.end")))
        assert settings == other_settings
        assert settings["step"] == BEFORE + AFTER
        assert arrays.keys() == others.keys()
        assert [name for name in arrays if arrays[name].tobytes() != others[name].tobytes()] == []
        assert whole.read_bytes() == Path(f"{path}.end").read_bytes()
        start = checkpoint.read(path)[1]
        assert (start["run/learner/params/actor/0/kernel"] != arrays["run/learner/params/actor/0/kernel"]).any()
    wholes = [np.frombuffer(whole.read_bytes(), np.uint8) for _, whole in runs]
    ends = [np.frombuffer(Path(f"{path}.end").read_bytes(), np.uint8) for path in paths]
    return sum(int((whole != end).sum()) for whole, end in zip(wholes, ends, strict=True))


FAST = [pytest.param("lqr", ["hl-gauss"], marks=pytest.mark.optimised), ("stateful_swing", ["gaussian"])]
SLOW = [*((env, list(LOSSES)) for env in ("lqr", "Reacher-v5", "stateful_swing")), ("Ant-v5", ["hl-gauss"])]


@pytest.mark.parametrize(
    ("env", "losses"),
    [*FAST, *(pytest.param(*case, marks=pytest.mark.slow) for case in SLOW)],
    ids=lambda value: value if isinstance(value, str) else f"{len(value)}",
)
def test_a_run_that_goes_on_in_a_new_process_equals_one_without_a_cut_byte_for_byte(env, losses, tmp_path, trust):
    if env.endswith("-v5"):
        pytest.importorskip("mujoco")
    differing = check_a_new_process_goes_on_exactly(env, losses, tmp_path)
    promise = "A run that is saved and gone on with in another process is one without a break."
    trust("resume", promise, topic="work", figure=differing, unit="bytes of the model differ", at_most=0)


@pytest.mark.slow
def test_an_environment_that_can_not_tell_its_state_goes_on_in_new_episodes_with_a_warning(tmp_path):
    train("swing", "hl-gauss", tmp_path / "model.cut")
    with pytest.warns(InexactResume, match=r"swing goes on from the start of new episodes: its environments can't"):
        model = A2C.load(tmp_path / "model.cut", env=swing.swing)
    saved = checkpoint.read(tmp_path / "model.cut")[1]
    assert not any(name.startswith("environments") for name in saved)
    np.testing.assert_array_equal(
        model.learner.normalizer.observation.mean, saved["run/learner/normalizer/observation/mean"][0]
    )
    assert model.num_timesteps == BEFORE
    model.learn(AFTER, progress_bar=False)
    assert model.num_timesteps == BEFORE + AFTER
    with pytest.warns(InexactResume, match="the checkpoint has no state"):
        A2C.load(tmp_path / "model.cut", env=swing.stateful_swing).learn(SIZE, progress_bar=False)


@pytest.mark.slow
def test_a_run_goes_on_in_pure_jax_after_gymnasium_with_a_warning_and_in_a_wrong_environment_not_at_all(tmp_path):
    model = A2C("galton/LQR-v0", n_bins=10, net_arch=(8,)).learn(160, progress_bar=False)
    path = model.save(tmp_path / "model")
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", InexactResume)
        A2C.load(path, env=LQR()).learn(160, progress_bar=False)
    for env, kind in (("mountain-car", "actions"), (LQR(A=np.eye(3), B=np.eye(3)[:, :2], Q=np.eye(3)), "observations")):
        with pytest.raises(UsageError, match=f"env has {kind}"):
            A2C.load(path, env=env)
