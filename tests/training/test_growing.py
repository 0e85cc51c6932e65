"""A process that trains for long holds no more than one that has just begun."""

import json
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

ROOT = Path(__file__).parents[2]
KILOBYTES = 300
"""How many more may be held after each 1,000 updates: of some hundred thousand, what the allocator keeps."""


@pytest.mark.slow
@pytest.mark.skipif(sys.platform != "linux", reason="/proc tells")
@pytest.mark.parametrize("engine", ["jax", "gymnasium"])
def test_10_000_updates_in_200_calls_of_learn_hold_no_more_than_the_first(engine, trust):
    command = [sys.executable, "-m", "tests.training.growing", engine]
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
