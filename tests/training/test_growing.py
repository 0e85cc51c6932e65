"""A process that trains for long holds no more than one that has just begun.

`python -m tests.training.test_growing ENGINE` is such a process, which ends with a JSON object; ENGINE is jax or
gymnasium. It makes 10,000 updates in 200 calls of `learn`, with all that users do between them.
"""

import gc
import json
import os
import subprocess
import sys
import tempfile
import threading
from pathlib import Path

import jax
import numpy as np
import pytest

import galton
from galton.callbacks import Checkpoint, Evaluate, JSONLines
from tests.envs.host.walks import Walk

ROOT = Path(__file__).parents[2]
KILOBYTES = 300
"""How many more may be held after each 1,000 updates: of some hundred thousand, what the allocator keeps."""


@pytest.mark.slow
@pytest.mark.skipif(sys.platform != "linux", reason="/proc tells")
@pytest.mark.parametrize("engine", ["jax", "gymnasium"])
def test_10_000_updates_in_200_calls_of_learn_hold_no_more_than_the_first(engine, trust):
    command = [sys.executable, "-m", "tests.training.test_growing", engine]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, timeout=3000)
    assert done.returncode == 0, done.stderr
    told = json.loads(done.stdout.splitlines()[-1])
    assert told["updates"] == 10_000
    later = np.array(told["held"])[100:]
    memory, files, threads, maps = later.T
    updates = np.arange(len(later)) * 50
    growth = 1_000 * np.polyfit(updates, memory, 1)[0]
    assert (len(set(files)), len(set(threads))) == (1, 1)
    assert maps.max() - maps.min() < 50
    assert told["programs"][0] > 0
    assert told["programs"][-1] == told["programs"][99], "something is compiled again and again"
    trust(
        "growth",
        "Training for 10,000 updates in 200 calls of `learn` holds no more memory, files, threads or programs.",
        topic="work",
        figure=round(max(growth, 0.0), 1),
        unit="KB more per 1,000 updates, by a line through the second half",
        at_most=KILOBYTES,
    )
    assert growth < KILOBYTES


CALLS, UPDATES = 200, 50
"""Calls of `learn`, and updates in each."""
SETTINGS = {"preset": "paper", "n_bins": 5, "net_arch": (4,), "n_steps": 5, "n_envs": 2, "normalize_observation": True}


def held():
    """Kilobytes in memory, open files, threads and pieces of mapped memory."""
    gc.collect()
    resident = int(Path("/proc/self/status").read_text().partition("VmRSS:")[2].split()[0])
    maps = Path("/proc/self/maps").read_bytes().count(b"\n")
    return [resident, len(os.listdir("/proc/self/fd")), threading.active_count(), maps]  # noqa: PTH208


def main(engine):
    galton.use_all_cores()
    compiled = []
    jax.monitoring.register_event_duration_secs_listener(
        lambda event, _, **__: compiled.append(event) if event.endswith("backend_compile_duration") else None
    )
    seen, programs = [], []
    with tempfile.TemporaryDirectory() as folder:
        model = galton.A2C("bandit" if engine == "jax" else Walk, **SETTINGS)
        size = UPDATES * model.settings["n_steps"] * model.settings["n_envs"]
        for _ in range(CALLS):
            calls = [Evaluate(size, 2), JSONLines(f"{folder}/log"), Checkpoint(f"{folder}/model", size)]
            model.learn(size, calls, progress_bar=False, log_interval=10)
            model.predict(np.zeros(model.observation_space.shape, np.float32))
            seen.append(held())
            programs.append(len(compiled))
    assert model.num_timesteps == CALLS * size
    print(json.dumps({"updates": CALLS * UPDATES, "held": seen, "programs": programs}))


if __name__ == "__main__":
    main(*sys.argv[1:])
