import itertools

import numpy as np
import pytest

from galton import BrokenEnvironmentError
from galton.envs.host.gymnasium import GymnasiumTask

from .walks import LENGTH, Unconvertible, Walk, Walks, begun, fail, observation, play, reward, terminated, truncated

SHAPE = r"the space is Box\(-inf, inf, \(2,\), float32\)"
FIVE = r"it must return \(observation, reward, terminated, truncated, info\)"
BROKEN_STEPS = {
    "observation NaN": (observation([0.0, np.nan]), r"entry \[1\] of the observation is nan, which is not finite"),
    "observation Inf": (observation([-np.inf, 0.0]), r"entry \[0\] of the observation is -inf, which is not finite"),
    "observation beyond float32": (observation([0.0, 1e39]), r"entry \[1\] .* 1e\+39, which is too large for float32"),
    "observation's shape": (observation(np.zeros(3)), rf"the observation is array.*of shape \(3,\); {SHAPE}"),
    "observation None": (observation(None), f"the observation is None; {SHAPE}"),
    "observation text": (observation("ab"), f"the observation is 'ab'; {SHAPE}"),
    "observation ragged": (observation([[1], [2, 3]]), rf"the observation is \[\[1\], \[2, 3\]\]; {SHAPE}"),
    "observation not convertible": (observation(Unconvertible()), f"the observation is <unconvertible>; {SHAPE}"),
    "reward NaN": (reward(np.nan), "the reward is nan, which is not finite"),
    "reward beyond float32": (reward(-1e300), r"the reward is -1e\+300, which is too large for float32"),
    "reward beyond float64": (reward(10**400), r"the reward is 10+\.\.\.; it must be one number"),
    "reward None": (reward(None), "the reward is None; it must be one number"),
    "reward text": (reward("1.0"), "the reward is '1.0'; it must be one number"),
    "reward of two": (reward(np.ones(2)), r"the reward is array\(\[1., 1.\]\) of shape \(2,\); it must be one number"),
    "reward not convertible": (reward(Unconvertible()), "the reward is <unconvertible>; it must be one number"),
    "terminated None": (terminated(None), "terminated is None; it must be True or False"),
    "terminated 2": (terminated(2), "terminated is 2; it must be True or False"),
    "terminated text": (terminated("False"), "terminated is 'False'; it must be True or False"),
    "terminated of two": (terminated(np.array([True, False])), "terminated is array.*; it must be True or False"),
    "truncated a float": (truncated(0.0), "truncated is 0.0; it must be True or False"),
    "four of the old gym": (lambda o, r, done, _, info: (o, r, done, info), rf"step returned \(array.*{FIVE}"),
    "None": (lambda *_: None, f"step returned None; {FIVE}"),
    "an error": (fail, "step raised ZeroDivisionError: the robot fell over"),
}


def test_a_broken_step_is_named_by_copy_step_and_value():
    for change, message in BROKEN_STEPS.values():
        envs = begun(Walks(change))
        play(envs, 36)
        with pytest.raises(BrokenEnvironmentError, match=f"^Odd, copy 2, step 37: {message}"):
            play(envs, 1)


def resets(answer):
    """An environment that is reset like this from its second episode on, in copy 1."""
    numbers = itertools.count()

    def make():
        number = next(numbers)

        class Resets(Walk):
            n_resets = 0

            def reset(self, *, seed=None, options=None):
                good = super().reset(seed=seed)
                self.n_resets += 1
                return answer(*good) if (number, self.n_resets) == (1, 2) else good

        return Resets()

    return make


RESET_TWO = r"reset returned .*; it must return \(observation, info\)"
BROKEN_RESETS = {
    "raises": (fail, "reset raised ZeroDivisionError: the robot fell over"),
    "only an observation": (lambda observed, _: observed, RESET_TWO),
    "None": (lambda *_: None, RESET_TWO),
    "three": (lambda *good: (*good, 1), RESET_TWO),
    "shape": (lambda *_: (np.zeros(5), {}), r"reset: the observation is .* of shape \(5,\); the space is"),
    "NaN": (lambda *_: ([np.nan, 0], {}), r"reset: entry \[0\] of the observation is nan"),
}


def test_a_broken_reset_is_named_by_copy_and_step():
    for answer, message in BROKEN_RESETS.values():
        envs = begun(resets(answer), 2)
        play(envs, LENGTH - 1, 2)
        with pytest.raises(BrokenEnvironmentError, match=f"copy 1, step {LENGTH}: ?{message}"):
            play(envs, 1, 2)

    class Old(Walk):
        def reset(self):
            return super().reset()

    with pytest.raises(BrokenEnvironmentError, match=r"Old, copy 0, step 0: reset raised TypeError: .*'seed'"):
        GymnasiumTask(Old).make(1).reset(np.arange(1))
