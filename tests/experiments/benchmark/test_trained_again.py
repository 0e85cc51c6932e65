"""A published part, trained again from the committed file, is what was published."""

import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pyarrow.parquet as pq
import pytest

from tests.trust import FOLDER

ROOT = Path(__file__).parents[3]
PART = Path("data", "fresh-bandit.parquet")


@pytest.mark.slow
@pytest.mark.skipif(not FOLDER, reason="all 26 methods take many minutes: `make trust` trains them")
def test_the_bandit_trained_again_under_ppo_is_what_was_published(tmp_path, trust):
    """All 26 methods, with what the published draws select. Other processors round otherwise, and runs then part."""
    shutil.copytree(ROOT / "results" / "winner", tmp_path, dirs_exist_ok=True)
    published = (tmp_path / PART).read_bytes()
    (tmp_path / PART).unlink()
    command = [sys.executable, "-m", "galton", "benchmark", ROOT / "benchmarks" / "winner.toml", "--out", tmp_path]
    subprocess.run(command, check=True, capture_output=True)

    before, after = (pq.read_table(folder / PART) for folder in (ROOT / "results" / "winner", tmp_path))
    keys = ["method", "role", "draw", "setting", "trial", "seed"]
    assert after.select(keys).equals(before.select(keys))
    finals = [np.asarray(table["final_judged"]) for table in (before, after)]
    apart = float(np.abs(finals[1] - finals[0]).max())
    promise = "One task of a published benchmark, trained again from the committed file, has the same returns."
    unit = "of 25, the most that a run's return differs"
    trust("benchmark-again", promise, topic="numbers", figure=apart, unit=unit, at_most=0.2)
    assert apart <= 0.2
    assert apart > 0 or (tmp_path / PART).read_bytes() == published
