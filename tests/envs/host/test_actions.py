"""Action spaces of Gymnasium as vectors: what is refused, and what environments get."""

import dataclasses
import json

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from gymnasium.spaces import Box, Dict, Discrete, MultiBinary, MultiDiscrete, Text, Tuple

from galton import UsageError, make_agent
from galton.envs.host.actions import Actions
from galton.envs.host.space_json import actions_from_json, actions_to_json

from .walks import UNIT, box


def bounds_set_later(low, high):
    """What Box's constructor refuses, but an environment can still do."""
    space = box([-1, -1, -1], [1, 1, 1])
    space.low, space.high = np.array(low, np.float32), np.array(high, np.float32)
    return space


OF_THESE = "acts in Box, Discrete, .* Wrap the environment so that it takes one .*TransformAction"
FINITE = r"Give it finite bounds: .*TransformAction.*Box\(low, high\)"
FLOATS = "a Box must be of floating-point numbers. Wrap the environment .* MultiDiscrete.* rounds"
RESCALE = "wrap the environment so that it takes {} actions .*RescaleAction"
ODD_ACTIONS = {
    "text inside": (Dict(gas=UNIT, say=Tuple([Text(3)])), rf"; \['say'\]\[0\] of Text; Galton {OF_THESE}"),
    "unbounded inside": (Dict(gas=Box(-np.inf, 1, (1,))), rf"; \['gas'\]; low is unbounded at \[0\].*{FINITE}"),
    "too many values": (MultiDiscrete([10**6, 2]), "1,000,002 values in all.*takes several smaller choices"),
    "none": (None, f"has actions None of NoneType.*{OF_THESE}"),
    "unbounded": (Box(-np.inf, np.inf, (2,)), rf"low is unbounded at \[0\].*{FINITE}"),
    "one dimension unbounded": (box([[0, 0]] * 3, [[1, 1], [1, np.inf], [1, 1]]), rf"unbounded at \[1, 1\].*{FINITE}"),
    "low is NaN": (bounds_set_later([-1, -1, np.nan], [1, 1, 1]), rf"low is not a number at \[2\].*{FINITE}"),
    "high is NaN": (bounds_set_later([-1, -1, -1], [1, np.nan, 1]), rf"high is not a number at \[1\].*{FINITE}"),
    "low above high": (bounds_set_later([-1, 3, -1], [1, 1, 1]), r"low must not lie above high, as at \[1\]"),
    "nothing": (Box(-1, 1, (0,)), "which are none; give them one entry at least"),
    "nothing inside": (Tuple([]), "which are none; give them one entry at least"),
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
            Actions("Robot", space)
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
    actions = Actions("Robot", space)
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
        Actions("Robot", Box(-1, 1, (2,), dtype)).to_env(chosen)[:] = 7
        np.testing.assert_array_equal(chosen, [0.5, -0.5])


NEST = Dict(
    motors=Box(np.float32([-1, 0]), np.float32([1, 4])),
    gripper=Discrete(2),
    gears=Tuple([MultiDiscrete([[3, 5]], start=[[1, 0]]), MultiBinary(2), Discrete(4, start=-2)]),
)
"""A Dict has its keys in the order in which they are written, and so has the vector."""


def test_a_nest_of_spaces_is_one_vector_of_numbers_and_indices():
    actions = Actions("Robot", NEST)
    assert actions.box.n_values == (0, 0, 2, 3, 5, 2, 2, 4)
    assert actions.box.low == (-1, 0, 0, 0, 0, 0, 0, 0)
    assert actions.box.high == (1, 4, 1, 2, 4, 1, 1, 3)
    rows = np.float32([[2.0, 1.5, 1, 2, 4, 0, 1, 3], [-0.5, -1, 0, 0, 0, 1, 1, 0]])
    first, second = (actions.one(actions.to_env(rows), i) for i in (0, 1))
    for action in (first, second):
        assert NEST.contains(action)
    np.testing.assert_array_equal(first["motors"], [1.0, 1.5])
    assert first["gripper"] == 1
    assert type(first["gripper"]) is int
    np.testing.assert_array_equal(first["gears"][0], [[3, 4]])
    np.testing.assert_array_equal(first["gears"][1], [0, 1])
    assert first["gears"][2] == 1
    assert second["gears"][2] == -2
    in_jax = jax.jit(jax.vmap(actions.to_env))(rows)
    jax.tree.map(np.testing.assert_array_equal, in_jax, jax.tree.map(np.asarray, actions.to_env(rows)))


def test_a_number_whose_bounds_are_equal_is_one_value():
    actions = Actions("Robot", Box(np.float32([-1, 2]), np.float32([1, 2])))
    assert actions.box.n_values == (0, 1)
    agent = make_agent(loss="hl-gauss", n_bins=5).on(actions.box)
    assert agent.policy.n_outputs == 6
    drawn = agent.policy.distribution(jnp.zeros(6), {}).sample(jnp.array([0.3, 0.9]))
    assert actions.to_env(np.asarray(drawn))[1] == 2
    only = Actions("Robot", Box(np.float32([2]), np.float32([2])))
    assert make_agent(loss="gaussian").on(only.box).policy.n_outputs == 1


@pytest.mark.parametrize("space", [NEST, Discrete(7), MultiDiscrete([2, 3])])
def test_every_space_comes_back_from_its_json(space):
    for n_mask in (0, 3):
        actions = dataclasses.replace(Actions("Robot", space), n_mask=n_mask)
        again = actions_from_json("Robot", json.loads(json.dumps(actions_to_json(actions))))
        assert again == actions
