"""Environments in wrappers go on exactly from their states, or say that they can't tell them: never neither."""

import gymnasium
import numpy as np
import pytest
from gymnasium import wrappers
from gymnasium.spaces import Box
from gymnasium.wrappers import TimeLimit
from stable_baselines3.common.monitor import Monitor

from galton import BrokenEnvironmentError
from galton.envs.find import find
from galton.envs.host.gymnasium import GymnasiumTask

from .walks import N, Stateful, Unconvertible, Walk, assert_same, begun, kind, play

DOUBLE = {"observation_space": Box(-np.inf, np.inf, (2,), np.float64)}
Long = kind("Long", Stateful, ends=lambda self: self.t == 12)
Precise = kind("Precise", Long, **DOUBLE, observe=lambda self: Long.observe(self) / np.float64(3))
"""One with episodes of twelve steps, and one that observes in float64 too."""


class Momentum(gymnasium.Wrapper):
    """The user's own, with a state that it does not tell."""

    late = 0.0

    def reset(self, **keywords):
        self.late = 0.0
        return super().reset(**keywords)

    def step(self, action):
        observed, reward, *others = super().step(action)
        self.late = 0.5 * self.late + reward
        return observed, self.late, *others


class Told(Momentum):
    """The same, which tells it."""

    def get_state(self):
        return {"late": self.late}

    def set_state(self, state):
        self.late = float(state["late"])


class Forwarding(Momentum):
    """The same, which passes on what it does not know, as wrappers of earlier Gymnasiums did."""

    def __getattr__(self, name):
        return getattr(self.env, name)


HalfTold = kind("HalfTold", Momentum, get_state=lambda self: {"late": self.late})
Warmer = kind("Warmer", wrappers.NormalizeReward)
"""One that tells its state and takes none, and a subclass, which may keep more than its parent."""


def running_mean(env):
    seen = []

    def mean(observed):
        seen.append(observed)
        return np.mean(seen[-3:], axis=0)

    return wrappers.TransformObservation(env, mean, env.observation_space)


EXACT = {
    "none": lambda env: env,
    "TimeLimit": lambda env: TimeLimit(env, 7),
    "RescaleAction": lambda env: wrappers.RescaleAction(env, np.float32(-3), np.float32(3)),
    "ClipReward": lambda env: wrappers.ClipReward(env, -0.5, 0.5),
    "OrderEnforcing": wrappers.OrderEnforcing,
    "PassiveEnvChecker": wrappers.PassiveEnvChecker,
    "RecordEpisodeStatistics": wrappers.RecordEpisodeStatistics,
    "FlattenObservation": wrappers.FlattenObservation,
    "RepeatAction": lambda env: wrappers.RepeatAction(env, 2),
    "Monitor": Monitor,
    "normalised time": lambda env: wrappers.TimeAwareObservation(TimeLimit(env, 11), normalize_time=True),
    "NormalizeReward": wrappers.NormalizeReward,
    "NormalizeObservation": wrappers.NormalizeObservation,
    "both": lambda env: Monitor(wrappers.NormalizeReward(wrappers.NormalizeObservation(TimeLimit(env, 7)), 0.9)),
    "twice": lambda env: wrappers.NormalizeReward(wrappers.NormalizeReward(env, 0.5), 0.9),
    "one of the user's own that tells": Told,
    "told between known ones": lambda env: wrappers.NormalizeReward(TimeLimit(Told(env), 7)),
}
INEXACT = {
    "FrameStackObservation": lambda env: wrappers.FrameStackObservation(env, 3),
    "StickyAction": lambda env: wrappers.StickyAction(env, 0.5),
    "DelayObservation": lambda env: wrappers.DelayObservation(env, 2),
    "MaxAndSkipObservation": lambda env: wrappers.MaxAndSkipObservation(env, 2),
    "a function": running_mean,
    "one of the user's own": Momentum,
    "one that forwards": Forwarding,
    "one that only tells": HalfTold,
    "one below a known one": lambda env: TimeLimit(Momentum(env), 7),
    "one above a known one": lambda env: Momentum(TimeLimit(env, 7)),
    "a subclass of a known one": Warmer,
}


@pytest.mark.parametrize("env", [Long, Precise])
@pytest.mark.parametrize("name", EXACT)
@pytest.mark.parametrize("n_before", [pytest.param(1, marks=pytest.mark.slow), 17])
def test_environments_in_known_wrappers_go_on_exactly(name, env, n_before):
    task = GymnasiumTask(lambda: EXACT[name](env()))
    envs, others = task.make(N), task.make(N)
    envs.reset(np.arange(N))
    others.reset(np.arange(N) + 50)
    play(others, 5, seed=2)
    play(envs, n_before)
    state = {key: value.copy() for key, value in envs.get_state().items()}
    expected = play(envs, 40, seed=1)
    others.set_state(state)
    assert_same(play(others, 40, seed=1), expected)
    assert {key: (value.shape, value.dtype) for key, value in others.get_state().items()} == {
        key: (value.shape, value.dtype) for key, value in state.items()
    }


def test_environments_in_wrappers_that_may_keep_a_state_say_that_they_can_not_tell_it():
    for name, around in INEXACT.items():
        envs = begun(lambda around=around: around(Long()))
        assert envs.get_state() is None, name


def test_one_copy_in_a_wrapper_that_keeps_a_state_is_enough_and_one_that_tells_does_not_help_what_does_not():
    made = iter([Long(), Long(), Momentum(Long())])
    for envs in (GymnasiumTask(lambda: next(made)).make(N), GymnasiumTask(lambda: Told(Walk())).make(N)):
        envs.reset(np.arange(N))
        assert envs.get_state() is None


def test_an_environment_of_an_id_is_restorable_in_all_that_gymnasium_puts_around_it():
    gymnasium.register("Long-v0", Long, max_episode_steps=5)
    try:
        envs = find("Long-v0").make(2)
    finally:
        del gymnasium.registry["Long-v0"]
    envs.reset(np.arange(2))
    play(envs, 3, 2)
    assert envs.get_state()["elapsed_steps"].tolist() == [[3], [3]]


@pytest.mark.parametrize(
    ("state", "message"),
    [
        (lambda _: [1], r"get_state returned \[1\], not a dict of arrays"),
        (lambda _: {"a": "text"}, "get_state's 'a' is 'text', not numbers"),
        (lambda _: {"a": Unconvertible()}, "get_state's 'a' is <unconvertible>, not numbers"),
        (lambda self: {"a": np.zeros(int(1e3 * abs(self.position)))}, r"get_state returned .*, but copy 0"),
        (lambda self: 1 / 0, "get_state raised ZeroDivisionError"),
    ],
)
def test_a_broken_state_is_named(state, message):
    class Strange(Stateful):
        get_state = state

    envs = begun(Strange, 2)
    with pytest.raises(BrokenEnvironmentError, match=rf"^Strange, copy \d, step 0: {message}"):
        envs.get_state()
