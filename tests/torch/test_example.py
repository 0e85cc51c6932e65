"""The example of PPO in one file runs, and its policy gets better."""

import re
import subprocess
import sys

import pytest

from ..running import ROOT


@pytest.mark.slow
def test_the_example_learns():
    command = [sys.executable, ROOT / "examples" / "cleanrl_ppo_histogram.py", "--total-timesteps", "20480"]
    done = subprocess.run(command, capture_output=True, text=True, check=True)
    returns = [float(found.replace(",", "")) for found in re.findall(r"return (\S+),", done.stdout)]
    assert len(returns) == 10
    assert returns[-1] > returns[0] + 150
