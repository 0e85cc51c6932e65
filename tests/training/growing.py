"""What a process holds while it trains for long: `python -m tests.training.growing ENGINE`, a JSON object at the end.

ENGINE is jax or gymnasium. 10,000 updates in 200 calls of `learn`, with all that users do between them.
"""

import gc
import json
import os
import sys
import tempfile
import threading
from pathlib import Path

import jax
import numpy as np

import galton
from galton.callbacks import Checkpoint, Evaluate, JSONLines
from tests.envs.host.walks import Walk

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
