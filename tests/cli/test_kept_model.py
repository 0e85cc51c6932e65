"""A model that is saved soon after an interrupt, whatever the thread that trains is doing."""

import signal
import subprocess
import sys
import threading
import time

import pytest

from galton import A2C, UsageError
from galton.cli import _kept_model
from galton.cli._kept_model import KeptModel
from galton.models import Model
from galton.saving import checkpoint

SLOW = """
import time
import gymnasium
import numpy as np

class Slow(gymnasium.Env):
    observation_space = action_space = gymnasium.spaces.Box(-1, 1, (1,))

    def reset(self, *, seed=None, options=None):
        super().reset(seed=seed)
        return np.zeros(1, np.float32), {}

    def step(self, action):
        time.sleep(0.01)
        return np.zeros(1, np.float32), 0.0, False, False, {}

gymnasium.register("Slow-v0", Slow, max_episode_steps=10)
"""
"""An environment of which a rollout of 700 steps takes more than 7 seconds."""
LONG = ["--n-steps", "700", "--n-bins", "8", "--steps", "700000", "--logs", "1000"]
MANY = ["--steps", "100000000", "--logs", "2000"]
RUNS = {
    "a2c in JAX": ["bandit", "--algorithm", "a2c", *MANY],
    "ppo in JAX": ["mountain-car", "--algorithm", "ppo", "--loss", "gaussian", *MANY],
    "a2c on Gymnasium's": ["Pendulum-v1", "--algorithm", "a2c", *MANY],
    "ppo on Gymnasium's": ["Pendulum-v1", "--algorithm", "ppo", *MANY],
    "a2c in batches": ["HalfCheetah-v5", "--algorithm", "a2c", *MANY],
    "ppo in batches": ["HalfCheetah-v5", "--algorithm", "ppo", "--n-envs", "8", *MANY],
    "a2c with long updates": ["slow:Slow-v0", "--algorithm", "a2c", *LONG],
    "ppo with long updates": ["slow:Slow-v0", "--algorithm", "ppo", "--batch-size", "100", *LONG],
}
ASKED = 5.0
"""Seconds that a batch system gives a process between SIGTERM and SIGKILL, at least."""


def wait_until(holds, seconds):
    end = time.monotonic() + seconds
    while not holds() and time.monotonic() < end:
        time.sleep(0.02)
    return holds()


@pytest.mark.slow
@pytest.mark.parametrize("kind", RUNS)
def test_five_seconds_after_sigterm_there_is_a_checkpoint_that_loads(kind, tmp_path, trust):
    if "HalfCheetah-v5" in RUNS[kind]:
        pytest.importorskip("mujoco")
    (tmp_path / "slow.py").write_text(SLOW)
    words = [*RUNS[kind], "--eval-episodes", "1", "--out", "run"]
    command = [sys.executable, "-m", "galton", "train", *words]
    process = subprocess.Popen(command, cwd=tmp_path, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True)
    file = tmp_path / "run" / "model.safetensors"
    begun = wait_until(file.exists, 300)
    time.sleep(2)
    before, sent = file.stat().st_mtime_ns, time.monotonic()
    process.send_signal(signal.SIGTERM)
    saved = wait_until(lambda: file.stat().st_mtime_ns != before, 60)
    seconds = time.monotonic() - sent
    wait_until(lambda: process.poll() is not None, ASKED - seconds)
    process.kill()
    _, err = process.communicate(timeout=60)
    assert begun, err
    assert saved, err
    assert process.returncode in (130, -signal.SIGKILL), err
    found = Model.load(file)
    assert found.num_timesteps > 0
    trust(
        "sigterm",
        "After SIGTERM `galton train` soon leaves a checkpoint that loads, however long an update takes.",
        topic="work",
        figure=round(seconds, 2),
        unit="seconds at most, over A2C and PPO on four kinds of environments",
        at_most=ASKED,
    )
    assert seconds < ASKED


@pytest.fixture(scope="module")
def model():
    return A2C("bandit", "hl-gauss", n_bins=4, net_arch=())


def kept(tmp_path, may_begin=True):
    begun = []

    def begin(taken):
        begun.append(taken.num_timesteps)
        taken.save(tmp_path / "model")

    return KeptModel(tmp_path / "model.safetensors", begin, lambda: may_begin), begun


def step(tmp_path):
    return checkpoint.read(tmp_path / "model.safetensors")[0]["step"]


@pytest.mark.slow
def test_what_was_taken_last_is_saved_while_training_goes_on(model, tmp_path, monkeypatch):
    monkeypatch.setattr(_kept_model, "SECONDS", 0.0)
    keep, begun = kept(tmp_path)
    keep.save_taken()
    assert not begun  # nothing was learnt yet
    keep.take(model)
    taken_at = model.num_timesteps
    model.learn(5, progress_bar=False)
    keep.save_taken()
    assert (begun, step(tmp_path)) == ([taken_at], taken_at)
    keep.save(model)
    assert step(tmp_path) == model.num_timesteps == taken_at + 5
    keep.save_taken()
    assert step(tmp_path) == taken_at + 5  # nothing earlier takes its place


def test_where_training_stops_by_itself_nothing_else_is_written(model, tmp_path):
    keep, begun = kept(tmp_path)
    keep.take(model)
    thread = threading.Thread(target=keep.save_taken)
    thread.start()
    keep.end()
    thread.join(_kept_model.SECONDS / 2)
    assert not thread.is_alive()
    assert not begun


def test_an_earlier_run_that_may_not_be_replaced_yet_is_left_and_a_full_disk_to_the_thread_that_trains(
    model, tmp_path, monkeypatch
):
    monkeypatch.setattr(_kept_model, "SECONDS", 0.0)
    keep, begun = kept(tmp_path, may_begin=False)
    keep.take(model)
    keep.save_taken()
    assert not begun
    keep = KeptModel(tmp_path / "model.safetensors", lambda _: (_ for _ in ()).throw(UsageError("full")), lambda: True)
    keep.take(model)
    keep.save_taken()
    with pytest.raises(UsageError, match="full"):
        keep.save(model)
    assert not [*tmp_path.iterdir()]


def test_taking_costs_little_however_long_it_takes(tmp_path, monkeypatch):
    now, n = [0.0], []

    class Large(Model):
        def __init__(self):
            pass

        def take(self):
            n.append(now[0])
            now[0] += 3.0

    monkeypatch.setattr(_kept_model.time, "monotonic", lambda: now[0])
    keep, _ = kept(tmp_path)
    for _ in range(2_000):
        keep.take(Large())
        now[0] += 0.5
    assert 2 <= len(n) <= 5  # of 3 s each, in 1,000 s
