import numpy as np
import pytest
from gymnasium.spaces import Box, Dict, Discrete

from galton import UsageError
from galton.envs.host.action_box import ActionBox

from .walks import UNIT, box


def bounds_set_later(low, high):
    """What Box's constructor refuses, but an environment can still do."""
    space = box([-1, -1, -1], [1, 1, 1])
    space.low, space.high = np.array(low, np.float32), np.array(high, np.float32)
    return space


A_BOX = "needs a Box. Wrap the environment so that it takes one .*TransformAction"
FINITE = r"Give it finite bounds: .*TransformAction.*Box\(low, high\)"
FLOATS = "needs a Box of floating-point numbers. Wrap the environment .* rounds"
WIDEN = "Leave that dimension out or widen it"
RESCALE = "wrap the environment so that it takes {} actions .*RescaleAction"
ODD_ACTIONS = {
    "discrete": (Discrete(3), rf"Discrete\(3\).*{A_BOX}"),
    "dict": (Dict(gas=UNIT), rf"Dict\('gas'.*{A_BOX}"),
    "none": (None, f"has actions None.*{A_BOX}"),
    "unbounded": (Box(-np.inf, np.inf, (2,)), rf"low is unbounded at \[0\].*{FINITE}"),
    "one dimension unbounded": (box([[0, 0]] * 3, [[1, 1], [1, np.inf], [1, 1]]), rf"unbounded at \[1, 1\].*{FINITE}"),
    "low is NaN": (bounds_set_later([-1, -1, np.nan], [1, 1, 1]), rf"low is not a number at \[2\].*{FINITE}"),
    "high is NaN": (bounds_set_later([-1, -1, -1], [1, np.nan, 1]), rf"high is not a number at \[1\].*{FINITE}"),
    "low is high": (box([-1, 2], [1, 2]), rf"low must lie below high at \[1\]. {WIDEN}"),
    "low above high": (bounds_set_later([-1, 3, -1], [1, 1, 1]), rf"low must lie below high at \[1\]. {WIDEN}"),
    "nothing": (Box(-1, 1, (0,)), "box without dimensions; give it one at least"),
    "integers": (Box(-5, 5, (2,), np.int64), f"whose type is int64.*{FLOATS}"),
    "beyond float32": (Box(-1e300, 1e300, (2,), np.float64), f"too large for float32.*{RESCALE.format('smaller')}"),
    "between two of float32": (
        Box(1e8, 1e8 + 1, (1,), np.float64),
        f"too narrow for float32.*{RESCALE.format('larger')}",
    ),
    "few of float32": (Box(1e8, 1e8 + 24, (1,)), "2 bins between them are too narrow for float32"),
    "subnormal": (Box(0, 1e-40, (1,)), f"too narrow for float32.*{RESCALE.format('larger')}"),
}


def test_an_odd_action_space_is_refused_with_what_to_do():
    for space, message in ODD_ACTIONS.values():
        with pytest.raises(UsageError, match=message) as caught:
            ActionBox("Robot", space)
        assert str(caught.value).startswith("Robot has actions ")


GOOD_ACTIONS = {
    "scalar": Box(-2, 3, ()),
    "matrix": box([[-1, -2, 0], [-5, 1, -0.1]], [[1, 3, 9], [-4, 2, 0.1]]),
    "float64": box([-0.1, 0.3], [0.1, 0.7], np.float64),
    "float64 scalar": Box(0.1, 0.7, (), np.float64),
    "float16": Box(-6e4, 6e4, (2,), np.float16),
    "huge": Box(-1.5e38, 1.5e38, (2,)),
    "small": Box(0, 1e-20, (2,)),
}


@pytest.mark.parametrize("name", GOOD_ACTIONS)
def test_actions_land_in_the_exact_bounds_in_the_spaces_shape_and_type(name):
    space = GOOD_ACTIONS[name]
    actions = ActionBox("Robot", space)
    low, high = actions.low, actions.high
    span = high - low
    rows = np.stack([low, high, low + span / 4, high + span / 2, low - span / 2])
    taken = actions.to_env(rows)
    assert taken.dtype == space.dtype
    assert taken.shape == (5, *space.shape)
    for i, action in enumerate(rows):
        single = actions.to_env(action)
        assert type(single) is np.ndarray
        assert space.contains(single)
        np.testing.assert_array_equal(single, taken[i])
    np.testing.assert_allclose(taken[:2].reshape(2, -1), rows[:2], rtol=1e-6)
    np.testing.assert_allclose(taken[2].ravel(), rows[2], rtol=1e-3)
    np.testing.assert_array_equal(taken[3], space.high)
    np.testing.assert_array_equal(taken[4], space.low)


def test_the_environments_actions_are_a_copy():
    for dtype in (np.float32, np.float64):
        chosen = np.array([0.5, -0.5], np.float32)
        ActionBox("Robot", Box(-1, 1, (2,), dtype)).to_env(chosen)[:] = 7
        np.testing.assert_array_equal(chosen, [0.5, -0.5])
