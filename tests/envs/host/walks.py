"""An environment for the adapters' tests, and what can be wrong with its answers."""

import itertools

import gymnasium
import numpy as np
from gymnasium.spaces import Box

from galton.envs.host.gymnasium import GymnasiumTask

LENGTH, N = 3, 3
"""Steps of an episode, and copies in most tests."""


def box(low, high, dtype=np.float32):
    return Box(np.array(low, dtype), np.array(high, dtype), dtype=dtype)


UNIT = box([-1], [1])


class Walk(gymnasium.Env):
    """Well-behaved: sums its actions and its generator's noise, and terminates after LENGTH steps."""

    observation_space = Box(-np.inf, np.inf, (2,))
    action_space = Box(-1, 1, (1,))

    def reset(self, *, seed=None, options=None):
        super().reset(seed=seed)
        self.position, self.t = self.np_random.normal(), 0
        return self.observe(), {}

    def observe(self):
        return np.array([self.position, self.t], np.float32)

    def ends(self):
        return self.t == LENGTH

    def step(self, action):
        self.position += float(action.sum()) + self.np_random.normal()
        self.t += 1
        return self.observe(), self.position, self.ends(), False, {}


def kind(name, base=Walk, **members):
    """A class of that name, a Walk with other members."""
    return type(name, (base,), members)


TALL = Box(np.array([[-1.0, 0.0], [0.0, -3.0]]), np.array([[2.0, 0.5], [4.0, 5.0]]), dtype=np.float64)
Tall = kind(
    "Tall",
    action_space=TALL,
    observation_space=Box(-1.0, 1.0, (2, 3)),
    observe=lambda self: self.np_random.uniform(-1, 1, (2, 3)).astype(np.float32),
)
"""Actions of shape (2, 2) in float64, unsymmetric; observations of shape (2, 3)."""


class Stateful(Walk):
    def get_state(self):
        return {"position": self.position, "t": np.array([self.t])}

    def set_state(self, state):
        self.position, self.t = float(state["position"]), int(state["t"][0])


class Closing(Walk):
    closed = 0

    def close(self):
        self.closed += 1


class Walks:
    """Makes Walks whose answers are changed at one step of one copy, counted from the copy's first reset."""

    def __init__(self, change, copy=2, at=37, base=Walk):
        self.change, self.copy, self.at, self.base = change, copy, at, base
        self.numbers, self.__name__ = itertools.count(), "Odd"

    def __call__(self):
        number, walks = next(self.numbers), self

        class Odd(walks.base):
            n_steps = 0

            def step(self, action):
                self.n_steps += 1
                answer = super().step(action)
                return walks.change(*answer) if (number, self.n_steps) == (walks.copy, walks.at) else answer

        return Odd()


def observation(value):
    return lambda _, *others: (value, *others)


def reward(value):
    return lambda observed, _, *others: (observed, value, *others)


def terminated(value):
    return lambda observed, reward, _, *others: (observed, reward, value, *others)


def truncated(value):
    return lambda observed, reward, ended, _, info: (observed, reward, ended, value, info)


def fail(*_):
    raise ZeroDivisionError("the robot fell over")


class Unconvertible:
    def __array__(self, *_, **__):
        raise RuntimeError("no array")

    def __repr__(self):
        return "<unconvertible>"


def random_actions(n_copies, seed=0):
    rng = np.random.default_rng(seed)
    while True:
        yield rng.uniform(-1, 1, (n_copies, 1)).astype(np.float32)


def begun(make, n_copies=N):
    """That many copies at the start of their first episodes."""
    envs = GymnasiumTask(make).make(n_copies)
    envs.reset(np.arange(n_copies))
    return envs


def play(envs, n_steps, n_copies=N, seed=0):
    """The stacked answers of that many steps."""
    steps = [envs.step(action) for _, action in zip(range(n_steps), random_actions(n_copies, seed), strict=False)]
    return [np.stack(column) for column in zip(*steps, strict=True)]


def assert_same(first, second):
    for one, other in zip(first, second, strict=True):
        np.testing.assert_array_equal(one, other)
