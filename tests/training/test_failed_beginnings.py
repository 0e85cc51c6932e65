"""An exception while a population of environments is made leaves no environment open and no thread behind."""

import gc
import threading
import time

import gymnasium
import numpy as np
import pytest
from gymnasium.spaces import Box, Discrete

import galton
from galton import A2C, BrokenEnvironmentError, UsageError, make_agent
from galton.callbacks import Evaluate
from galton.training import on_host
from galton.training.host_group import Group

SMALL = {"preset": "paper", "n_bins": 4, "net_arch": (4,), "n_steps": 4}
AGENT = make_agent(n_bins=4, net_arch=(4,), n_steps=4)


class Rooms:
    """Makes environments, counts those that are open, and fails at one of them in one way."""

    def __init__(self, fails="", at=2):
        self.fails, self.at, self.n_made, self.open = fails, at, 0, []
        self.__name__ = "Room"

    def __call__(self):
        number, rooms = self.n_made, self
        self.n_made += 1
        failing = number == self.at and self.fails
        if failing in ("make", "interrupt"):
            raise {"make": ZeroDivisionError, "interrupt": KeyboardInterrupt}[failing]

        class Room(gymnasium.Env):
            observation_space = Box(-1, 1, (3,) if failing == "other spaces" else (2,))
            action_space = Discrete(3) if failing == "discrete actions" else Box(-1, 1, (1,))

            def __init__(self):
                rooms.open.append(number)
                if failing == "no space":
                    self.observation_space = "a box"

            def reset(self, *, seed=None, options=None):
                super().reset(seed=seed)
                if failing == "reset":
                    raise ZeroDivisionError
                return np.full(2, np.nan if failing == "observation" else 0, np.float32), {}

            def step(self, action):
                return np.zeros(2, np.float32), 0.0, True, False, {}

            def close(self):
                rooms.open.remove(number)

        return Room()


def threads():
    return {thread.ident for thread in threading.enumerate()}


def begin_and_fail(rooms, begin, error):
    before = threads()
    with pytest.raises(error):
        begin(rooms)
    gc.collect()
    assert rooms.n_made > rooms.at
    assert (rooms.open, threads() - before) == ([], set())


BROKEN = dict.fromkeys(("reset", "observation"), BrokenEnvironmentError)
FAILURES = dict.fromkeys(("make", "other spaces", "no space"), UsageError) | {"interrupt": KeyboardInterrupt} | BROKEN


OF_THE_FIRST = [(fails, 0) for fails in FAILURES if fails != "other spaces"]  # the first copy says what they are


@pytest.mark.few
@pytest.mark.parametrize(("fails", "at"), [*((fails, 2) for fails in FAILURES), *OF_THE_FIRST])
def test_a_model_that_can_not_begin(fails, at):
    begin_and_fail(Rooms(fails, at), lambda rooms: A2C(rooms, n_envs=3, **SMALL), FAILURES[fails])


@pytest.mark.few
@pytest.mark.parametrize("fails", FAILURES)
def test_runs_that_can_not_begin(fails):
    begin_and_fail(Rooms(fails), lambda rooms: galton.train(rooms, AGENT, [0, 1, 2], 8), FAILURES[fails])


@pytest.mark.few
@pytest.mark.parametrize(
    "settings", [{"n_envs": 10**9}, {"loss": "mse"}, {"learning_rate": -1.0}, {"seed": -1}], ids=str
)
def test_an_environment_that_was_made_to_be_looked_at_is_closed_where_no_model_comes_of_it(settings):
    begin_and_fail(Rooms(at=0), lambda rooms: A2C(rooms, **SMALL | settings), UsageError)
    begin_and_fail(Rooms("discrete actions", at=0), lambda rooms: A2C(rooms), UsageError)


@pytest.mark.slow
def test_an_evaluation_that_can_not_begin_closes_its_own_copies_and_leaves_training_its():
    rooms = Rooms("make", at=3)
    model = A2C(rooms, n_envs=1, **SMALL)
    for callback in (Evaluate(4, n_episodes=5), Evaluate(4, n_episodes=5, env=Rooms("make"))):
        with pytest.raises(UsageError):
            model.learn(8, callback, progress_bar=False)
        rooms.n_made = 1
    assert rooms.open == [0]
    model.learn(8, progress_bar=False)
    model.close()
    assert rooms.open == []


@pytest.mark.few
@pytest.mark.parametrize("method", ["reset", "begin"])
def test_where_one_group_of_several_fails_the_others_are_waited_for_and_closed(monkeypatch, method):
    """A group that is still resetting its environments must not have them closed under its feet."""
    pytest.importorskip("mujoco")
    inside, closed_inside = [], []
    own = getattr(Group, method)

    def slowly(group):
        if group._seeds[0] == 0:
            raise ZeroDivisionError
        inside.append(group)
        time.sleep(0.3)
        own(group)
        inside.remove(group)

    close = Group.close
    monkeypatch.setattr(Group, method, slowly)
    monkeypatch.setattr(Group, "close", lambda group: (closed_inside.append(bool(inside)), close(group)))
    monkeypatch.setattr("galton.envs.host.mujoco.n_cores", lambda: 2)
    before = threads()
    devices = galton.training.population.jax.devices()[:1] * 2
    monkeypatch.setattr(on_host, "min", lambda *_: 2, raising=False)
    with pytest.raises(ZeroDivisionError):
        galton.train("Reacher-v5", AGENT, [0, 1], 8, devices=devices)
    assert closed_inside == [False, False]
    assert threads() == before
