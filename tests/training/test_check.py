"""What `check_env` says of environments, good and bad."""

import re

import numpy as np
import pytest
from gymnasium.spaces import Box
from gymnasium.vector import AutoresetMode, SyncVectorEnv
from gymnasium.wrappers import NormalizeObservation, TimeLimit

import galton
from galton.training import check
from galton.training.probe import Spread

from ..envs.host.walks import Stateful, Walk, Walks, fail, kind


@pytest.fixture(autouse=True)
def short(monkeypatch):
    monkeypatch.setattr(check, "SECONDS", 0.3)


def last(self):
    self.array = getattr(self, "array", np.zeros(2, np.float32))
    self.array[:] = Walk.observe(self)
    return self.array


def unseeded(self, *, seed=None, options=None):
    Walk.reset(self, seed=seed)
    self.position = float(next(STARTS))
    return self.observe(), {}


def unrewarded(self, action):
    observation, _, *ends = Walk.step(self, action)
    return observation, 0.0, *ends


STARTS = iter(range(1000))
Endless = kind("Endless", ends=lambda self: False)
Aliasing = kind("Aliasing", observe=last)
Far = kind("Far", observe=lambda self: Walk.observe(self) * 1e6)
Deaf = kind("Deaf", step=lambda self, action: Walk.step(self, np.zeros(1)))
Unseeded = kind("Unseeded", reset=unseeded)
IMAGES = {"observation_space": Box(0, 255, (4, 4, 3), np.uint8)}
Seeing = kind("Seeing", **IMAGES, observe=lambda self: np.full((4, 4, 3), self.t, np.uint8))
Nothing = kind("Nothing", step=unrewarded)
Told = kind("Told", get_state=Walk.observe, set_state=lambda self, state: None)
Cut = kind("Cut", ends=lambda self: self.t == 5)


def found(env, **kwargs):
    return {finding.name: finding for finding in galton.check_env(env, **kwargs).findings}


GOOD = [lambda: Stateful(), "lqr", "bandit", "Pendulum-v1"]
NOTES = {
    "no end": (Endless, "time limit", "none was found", "TimeLimit"),
    "aliasing": (Aliasing, "arrays", "writes into the array", "return a copy"),
    "far from 0": (Far, "scale of observations", "e.06", "normalize_observation=True"),
    "deaf": (Deaf, "effect of actions", "change neither observations nor rewards", "uses its action"),
    "unseeded": (Unseeded, "seeds", "another first observation", "self.np_random"),
    "image": (Seeing, "observations", r"\(4, 4, 3\), seen as a vector of 48 numbers", "Galton has no convolutions"),
    "no reward": (Nothing, "rewards", "0 in each of", "nothing to learn from"),
    "a time limit as an end": (Cut, "ends of episodes", "0 truncated, after 5 steps", "return it as truncated"),
    "statistics": (lambda: NormalizeObservation(Walk()), "statistics", "NormalizeObservation", "normalize_observation"),
    "a state of another kind": (Told, "resume", "begins new episodes", "get_state returned array"),
    "no state": (Walk, "resume", "begins new episodes", "get_state and set_state"),
}
BROKEN = {
    "raising": (Walks(fail, 0, 4), "steps", "ZeroDivisionError: the robot fell over"),
    "not made": (lambda: 1 / 0, "environment", "division by zero"),
    "unknown": ("Pendulm-v1", "environment", "Pendulm-v1"),
    "nothing": (None, "environment", "env is None"),
}


@pytest.mark.few
@pytest.mark.parametrize("env", GOOD)
def test_what_can_be_trained_on_is_ok_and_its_returns_are_told(env):
    each = found(env)
    assert all(finding.ok for finding in each.values())
    assert {"actions", "observations", "time limit", "resume", "speed"} <= set(each)
    for name in ("doing nothing", "random actions"):
        assert "episode" in each[name].value
    assert not each["seeds"].remedy
    assert not each["effect of actions"].remedy


@pytest.mark.parametrize(("env", "name", "value", "remedy"), NOTES.values(), ids=NOTES)
def test_what_is_amiss_is_told_with_its_remedy(env, name, value, remedy):
    finding = found(env)[name]
    assert finding.ok
    assert re.search(value, finding.value)
    assert remedy in finding.remedy


@pytest.mark.parametrize(("env", "name", "value"), BROKEN.values(), ids=BROKEN)
def test_what_breaks_is_a_finding_and_no_error(env, name, value):
    result = galton.check_env(env)
    assert not result.ok
    assert [finding.name for finding in result.findings if not finding.ok] == [name]
    assert re.search(value, result.findings[-1].value)
    assert result.findings[-1].remedy


def test_numbers_are_those_that_the_environment_gives(monkeypatch):
    monkeypatch.setattr(check, "SECONDS", 60.0)  # all episodes end before, also where the machine is busy
    each = found("lqr", env_kwargs={"max_episode_steps": 7})
    assert each["actions"].value.startswith("2 in [-1, 1]")
    assert each["time limit"].value == "7 steps"
    assert each["ends of episodes"].value == "0 terminated and 20 truncated, after 7 steps"
    assert found(lambda: TimeLimit(Endless(), 7))["time limit"].value == "7 steps"
    assert found(Walk)["random actions"].value.endswith("(deviation of 10 episodes)")


def test_an_environment_that_is_there_and_a_vector_of_them_can_be_checked():
    assert found(Stateful())["resume"].value.startswith("exact")
    vector = SyncVectorEnv([Walk] * 2, autoreset_mode=AutoresetMode.SAME_STEP)
    each = found(vector)
    assert "2 copies" in each["environment"].value
    assert "2 copies together" in each["speed"].value
    assert not galton.check_env(SyncVectorEnv([Walk] * 2)).ok
    env = NormalizeObservation(Walk())
    galton.check_env(env)
    assert env.obs_rms.count == pytest.approx(1e-4), "statistics stay as they are"


def test_a_spread_is_numpys():
    rows = np.random.default_rng(0).normal(1e6, 1, (50, 3)) * [1, 1, 0]
    spread = Spread()
    for part in np.array_split(rows, 7):
        spread.add(part)
    np.testing.assert_allclose(spread.mean, rows.mean(0), rtol=1e-12)
    np.testing.assert_allclose(spread.deviation, rows.std(0), rtol=1e-6)
    np.testing.assert_array_equal((spread.low, spread.high), (rows.min(0), rows.max(0)))
