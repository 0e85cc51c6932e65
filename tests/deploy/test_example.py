"""examples/deploy.py runs a policy where nothing of Galton can be imported."""

import re
import subprocess
import sys
from pathlib import Path

import gymnasium
import numpy as np
import pytest

import galton

EXAMPLE = Path(__file__).parents[2] / "examples" / "deploy.py"
FORBIDDEN = """
import runpy, sys

class Forbidden:
    def find_spec(self, name, path=None, target=None):
        if name.split(".")[0] in ("galton", "jax", "jaxlib", "gymnasium", "onnx", "scipy"):
            raise ImportError(f"{name} is not there")

sys.meta_path.insert(0, Forbidden())
sys.argv = sys.argv[1:]
runpy.run_path(sys.argv[0], run_name="__main__")
"""


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """A folder with a policy that turns a pendulum somehow."""
    folder = tmp_path_factory.mktemp("exported")
    model = galton.A2C("Pendulum-v1", "hl-gauss", n_bins=5, net_arch=(8,), normalize_observation=True)
    galton.deploy.export(model, folder / "policy.onnx")
    return folder


def run(folder):
    command = [sys.executable, "-c", FORBIDDEN, EXAMPLE, folder]
    return subprocess.run(command, capture_output=True, text=True, timeout=100)


@pytest.mark.slow
def test_the_example_runs_a_policy_without_galton_or_jax(folder):
    done = run(folder)
    assert done.returncode == 0, done.stderr
    assert "a2c with hl-gauss, 0 steps, rule: mode" in done.stdout
    assert re.search(r"return of 10 swings: -\d+ ± \d+", done.stdout)


def test_a_file_that_the_contract_does_not_describe_is_refused(folder, tmp_path):
    for name in ("policy.onnx", "policy.json"):
        (tmp_path / name).write_bytes((folder / name).read_bytes())
    with (tmp_path / "policy.onnx").open("ab") as file:
        file.write(b"\0")
    done = run(tmp_path)
    assert done.returncode == 1
    assert "policy.onnx is not the file that policy.json describes" in done.stderr


def test_its_pendulum_is_gymnasiums(monkeypatch):
    monkeypatch.syspath_prepend(EXAMPLE.parent)
    import deploy

    def act(observations):
        return np.clip(2 * observations[:, 1:2] - observations[:, 2:], -2, 2)

    (found,) = deploy.swing_up(act, n_episodes=1, seed=3)
    env, rng, expected = gymnasium.make("Pendulum-v1"), np.random.default_rng(3), 0.0
    env.reset(seed=0)
    env.unwrapped.state = np.array([rng.uniform(-np.pi, np.pi, 1)[0], rng.uniform(-1, 1, 1)[0]])
    observation = env.unwrapped._get_obs()
    for _ in range(200):
        observation, reward, *_ = env.step(act(observation[None])[0])
        expected += reward
    assert found == pytest.approx(expected, rel=1e-3)
