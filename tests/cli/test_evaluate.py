"""What a trained policy earns is what its model evaluates to, on the environment of its run or another one."""

import json
import re

import numpy as np
import pytest
from scipy import stats

from galton import A2C, UsageError
from galton.cli import evaluate


@pytest.fixture(scope="module")
def run(tmp_path_factory):
    """A run folder as `galton train` leaves it, as far as evaluation looks at it."""
    folder = tmp_path_factory.mktemp("run")
    A2C("bandit", n_bins=2, net_arch=(), env_kwargs={"noise_std": 0.5}).save(folder / "model.safetensors")
    (folder / "config.json").write_text(json.dumps({"env": "bandit", "env_kwargs": {"noise_std": 0.5}}))
    return folder


@pytest.mark.slow
def test_it_prints_the_returns_their_mean_and_its_interval(run, capsys):
    evaluate.main([str(run), "--episodes", "7"])
    first, second, _ = capsys.readouterr().out.splitlines()
    model = A2C.load(run / "model.safetensors")
    returns = model.evaluate(7, "bandit", {"noise_std": 0.5}).astype(np.float64)
    assert first == "returns " + ", ".join(f"{value:.2f}" for value in returns)
    told = [float(number) for number in re.findall(r"-?\d+\.\d+", second)]
    interval = stats.ttest_1samp(returns, 0.0).confidence_interval(0.95)
    assert told == pytest.approx([returns.mean(), *interval, returns.std()], abs=0.006)


def test_without_a_runs_settings_the_environment_is_to_be_named(run, tmp_path, capsys):
    alone = tmp_path / "alone.safetensors"
    alone.write_bytes((run / "model.safetensors").read_bytes())
    with pytest.raises(UsageError, match=r"env is not known: there is no config.json beside .*; give --env"):
        evaluate.main([str(alone)])
    evaluate.main([str(alone), "--env", "bandit", "--episodes", "2"])
    assert "2 episodes of" in capsys.readouterr().out
