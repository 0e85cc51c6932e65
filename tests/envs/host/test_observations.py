from collections import OrderedDict

import numpy as np
import pytest
from gymnasium.spaces import (
    Box,
    Dict,
    Discrete,
    Graph,
    MultiBinary,
    MultiDiscrete,
    OneOf,
    Sequence,
    Text,
    Tuple,
)
from gymnasium.spaces.utils import flatten
from gymnasium.vector.utils import batch_space, concatenate, create_empty_array

from galton import BrokenEnvironmentError, UsageError
from galton.envs.host.action_box import ActionBox
from galton.envs.host.observations import Observations
from galton.envs.host.space_json import from_json, to_json


def box(low, high, dtype=np.float32):
    return Box(np.array(low, dtype), np.array(high, dtype), dtype=dtype)


def bounds_set_later(low, high):
    """What Box's constructor refuses, but an environment can still do."""
    space = box([-1, -1, -1], [1, 1, 1])
    space.low, space.high = np.array(low, np.float32), np.array(high, np.float32)
    return space


UNIT = box([-1], [1])
A_BOX = "needs a Box. Wrap the environment so that it takes one .*TransformAction"
FINITE = r"Give it finite bounds: .*TransformAction.*Box\(low, high\)"
FLOATS = "needs a Box of floating-point numbers. Wrap the environment .* rounds"
WIDEN = "Leave that dimension out or widen it"
RESCALE = "wrap the environment so that it takes {} actions .*RescaleAction"

ODD_ACTIONS = {
    "discrete": (Discrete(3), rf"Discrete\(3\).*{A_BOX}"),
    "multi-discrete": (MultiDiscrete([2, 3]), rf"MultiDiscrete\(\[2 3\]\).*{A_BOX}"),
    "multi-binary": (MultiBinary(4), rf"MultiBinary\(4\).*{A_BOX}"),
    "text": (Text(5, charset="ab"), rf"Text\(1, 5.*{A_BOX}"),
    "dict": (Dict(gas=UNIT), rf"Dict\('gas'.*{A_BOX}"),
    "tuple": (Tuple([UNIT, UNIT]), rf"Tuple\(Box.*{A_BOX}"),
    "sequence": (Sequence(UNIT), rf"Sequence\(.*{A_BOX}"),
    "graph": (Graph(UNIT, None), rf"Graph\(.*{A_BOX}"),
    "one of": (OneOf([UNIT, Discrete(2)]), rf"OneOf\(.*{A_BOX}"),
    "none": (None, f"has actions None.*{A_BOX}"),
    "pair": ((-1, 1), rf"has actions \(-1, 1\).*{A_BOX}"),
    "unbounded": (Box(-np.inf, np.inf, (2,)), rf"low is unbounded at \[0\].*{FINITE}"),
    "unbounded below": (Box(-np.inf, 1, (2,)), rf"low is unbounded at \[0\].*{FINITE}"),
    "unbounded above": (Box(-1, np.inf, (2,)), rf"high is unbounded at \[0\].*{FINITE}"),
    "one dimension unbounded": (box([[0, 0]] * 3, [[1, 1], [1, np.inf], [1, 1]]), rf"unbounded at \[1, 1\].*{FINITE}"),
    "low is NaN": (bounds_set_later([-1, -1, np.nan], [1, 1, 1]), rf"low is not a number at \[2\].*{FINITE}"),
    "high is NaN": (bounds_set_later([-1, -1, -1], [1, np.nan, 1]), rf"high is not a number at \[1\].*{FINITE}"),
    "low is high": (box([-1, 2], [1, 2]), rf"low must lie below high at \[1\]. {WIDEN}"),
    "low above high": (bounds_set_later([-1, 3, -1], [1, 1, 1]), rf"low must lie below high at \[1\]. {WIDEN}"),
    "nothing": (Box(-1, 1, (0,)), "box without dimensions; give it one at least"),
    "no columns": (Box(-1, 1, (3, 0)), "box without dimensions; give it one at least"),
    "integers": (Box(-5, 5, (2,), np.int64), f"whose type is int64.*{FLOATS}"),
    "bytes": (Box(0, 255, (2,), np.uint8), f"whose type is uint8.*{FLOATS}"),
    "switches": (Box(0, 1, (2,), bool), f"whose type is bool.*{FLOATS}"),
    "beyond float32": (Box(-1e300, 1e300, (2,), np.float64), f"too large for float32.*{RESCALE.format('smaller')}"),
    "a span beyond float32": (Box(-3.4e38, 3.4e38, (1,)), f"too large for float32.*{RESCALE.format('smaller')}"),
    "between two of float32": (
        Box(1e8, 1e8 + 1, (1,), np.float64),
        f"too narrow for float32.*{RESCALE.format('larger')}",
    ),
    "few of float32": (Box(1e8, 1e8 + 24, (1,)), "2 bins between them are too narrow for float32"),
    "subnormal": (Box(0, 1e-40, (1,)), f"too narrow for float32.*{RESCALE.format('larger')}"),
}


@pytest.mark.parametrize("name", ODD_ACTIONS)
def test_an_odd_action_space_is_refused_with_what_to_do(name):
    space, message = ODD_ACTIONS[name]
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


@pytest.mark.parametrize("dtype", [np.float32, np.float64])
def test_the_environments_actions_are_a_copy(dtype):
    actions = ActionBox("Robot", Box(-1, 1, (2,), dtype))
    chosen = np.array([0.5, -0.5], np.float32)
    actions.to_env(chosen)[:] = 7
    np.testing.assert_array_equal(chosen, [0.5, -0.5])


OBSERVATIONS = {
    "vector": Box(-1, 1, (3,)),
    "unbounded": Box(-np.inf, np.inf, (3,), np.float64),
    "half-bounded": box([0, -np.inf], [np.inf, 1]),
    "scalar": Box(-1, 1, ()),
    "image": Box(0, 255, (4, 5, 3), np.uint8),
    "discrete": Discrete(5, start=-2),
    "small discrete": Discrete(3, dtype=np.int8),
    "multi-discrete": MultiDiscrete([2, 3], start=[4, -1]),
    "discrete matrix": MultiDiscrete([[2, 3], [4, 5]], dtype=np.int32),
    "multi-binary": MultiBinary(4),
    "binary matrix": MultiBinary((2, 3)),
    "dict": Dict(position=box([-1, -2], [1, 2]), gear=Discrete(4)),
    "dict in an order of its own": Dict(OrderedDict(z=Box(-1, 1, (2,)), a=Box(5, 6, (3,)))),
    "tuple": Tuple([Box(-1, 1, (2, 2)), MultiBinary(3)]),
    "nested": Dict(
        eye=Box(0, 255, (2, 2), np.uint8), limbs=Tuple([Dict(a=Discrete(2), b=Box(-1, 1, ())), MultiDiscrete([2, 2])])
    ),
}


@pytest.fixture(params=OBSERVATIONS)
def space(request):
    space = OBSERVATIONS[request.param]
    space.seed(3)
    return space


def test_observations_are_flattened_as_gymnasium_does(space):
    observations = Observations("Robot", space)
    for _ in range(5):
        raw = space.sample()
        flat = observations.flatten(raw, "here")
        assert flat.dtype == np.float32
        assert flat.shape == (observations.size,)
        np.testing.assert_array_equal(flat, np.asarray(flatten(space, raw), np.float32))


def test_rows_tell_one_observation_from_a_batch(space):
    observations = Observations("Robot", space)
    samples = [space.sample() for _ in range(3)]
    expected = np.stack([observations.flatten(raw, "here") for raw in samples])
    one, single = observations.rows(samples[0])
    assert single
    np.testing.assert_array_equal(one, expected[:1])
    batch = concatenate(space, samples, create_empty_array(space, 3))
    assert batch in batch_space(space, 3)
    rows, single = observations.rows(batch)
    assert not single
    np.testing.assert_array_equal(rows, expected)


def test_a_space_comes_back_from_a_file_and_flattens_the_same(space):
    again = from_json(to_json(space))
    assert again == space
    raw = space.sample()
    np.testing.assert_array_equal(
        Observations("Robot", again).flatten(raw, "here"), Observations("Robot", space).flatten(raw, "here")
    )


@pytest.mark.parametrize("dtype", [np.float32, np.float64])
def test_bounds_come_back_from_a_file_exactly(dtype):
    space = box([[-0.1, -np.inf, 1 / 3]], [[np.inf, 0.7, 1e30]], dtype)
    again = from_json(to_json(space))
    assert again == space
    assert (again.shape, again.dtype) == (space.shape, space.dtype)


UNFLATTENABLE = {
    "text": Text(5),
    "sequence": Sequence(UNIT),
    "graph": Graph(UNIT, None),
    "one of": OneOf([UNIT, Discrete(2)]),
    "text in a dict": Dict(a=UNIT, words=Text(5)),
    "sequence in a tuple": Tuple([UNIT, Sequence(UNIT)]),
}


@pytest.mark.parametrize("name", UNFLATTENABLE)
def test_observations_without_a_fixed_size_are_refused(name):
    with pytest.raises(UsageError, match=r"Robot observes .*can be flattened: wrap the environment .*observes a Box"):
        Observations("Robot", UNFLATTENABLE[name])


@pytest.mark.parametrize("empty", [Box(-1, 1, (0,)), Dict(), Tuple([])], ids=["box", "dict", "tuple"])
def test_observations_of_nothing_are_refused(empty):
    with pytest.raises(UsageError, match=r"Robot observes .*, which is empty; wrap the environment"):
        Observations("Robot", empty)


class Unprintable:
    def __repr__(self):
        raise RuntimeError("no")

    def __array__(self, *_, **__):
        raise RuntimeError("no array")


PARTS = Dict(a=Box(-1, 1, (2,)), b=Tuple([Discrete(3), Box(0, 255, (2,), np.uint8)]), c=MultiDiscrete([2, 2]))
GOOD = {"a": [0.5, 0.5], "b": (1, [3, 4]), "c": [0, 1]}
WRONG = {
    "a key is missing": ({"a": [0.5, 0.5]}, r"the keys of the observation are \['a'\]"),
    "a key too many": (GOOD | {"d": 1}, r"the keys of the observation are \['a', 'b', 'c', 'd'\]"),
    "no dict": ([1, 2], "the observation is"),
    "nothing": (None, "the observation is None"),
    "a shape": (GOOD | {"a": [0.5]}, r"the observation\['a'\] is \[0.5\], which must have shape \(2,\)"),
    "text": (GOOD | {"a": ["1", "2"]}, r"the observation\['a'\] is \['1', '2'\]"),
    "NaN": (GOOD | {"a": [0.5, np.nan]}, r"entry \[1\] of the observation\['a'\] is nan, which is not finite"),
    "NaN among bytes": (GOOD | {"b": (1, [np.nan, 0])}, r"entry \[0\] of the observation\['b'\]\[1\] is nan"),
    "too large": (GOOD | {"a": [1e300, 0]}, r"entry \[0\] of the observation\['a'\] is 1e\+300, .*too large"),
    "no byte": (GOOD | {"b": (1, [0.5, 300])}, r"the observation\['b'\]\[1\] is \[0.5, 300\], which must be uint8"),
    "a short tuple": (GOOD | {"b": (1,)}, r"the observation\['b'\] must be a tuple of 2"),
    "a category below": (GOOD | {"b": (-1, [3, 4])}, r"the observation\['b'\]\[0\] is -1, which is not in Discrete"),
    "a category above": (GOOD | {"b": (3, [3, 4])}, r"the observation\['b'\]\[0\] is 3, which is not in Discrete"),
    "another's category": (GOOD | {"c": [2, 0]}, r"the observation\['c'\] is \[2, 0\], which is not in MultiDiscrete"),
    "an object": (GOOD | {"a": Unprintable()}, r"the observation\['a'\] is a Unprintable that can't be shown"),
}


@pytest.mark.parametrize("name", WRONG)
def test_a_part_that_does_not_fit_is_named(name):
    raw, message = WRONG[name]
    observations = Observations("Robot", PARTS)
    observations.flatten(GOOD, "here")
    with pytest.raises(BrokenEnvironmentError, match=f"^Robot, copy 2, step 7: .*{message}"):
        observations.flatten(raw, "Robot, copy 2, step 7")


@pytest.mark.parametrize(
    ("observed", "raw", "message"),
    [
        (Box(-1, 1, (3,)), np.zeros(4), r"its shape is \(4,\)"),
        (Box(-1, 1, (3,)), np.zeros((2, 2, 3)), r"its shape is \(2, 2, 3\)"),
        (Box(-1, 1, (3,)), ["a", "b", "c"], "its type is <U1"),
        (Box(-1, 1, (3,)), [[1], [2, 3]], "observation is"),
        (Box(-1, 1, (3,)), [0, np.nan, 0], r"entry \[1\] of it is nan"),
        (Box(-1, 1, (3,)), None, "observation is None"),
        (PARTS, GOOD | {"a": [0.5]}, "which must have shape"),
        (PARTS, None, "observation is None"),
        (Dict(a=Box(-1, 1, (2,)), b=Discrete(3)), {"a": np.zeros((3, 2)), "b": [0, 1]}, r"batches of \[2, 3\]"),
    ],
)
def test_predict_refuses_what_the_space_can_not_hold(observed, raw, message):
    with pytest.raises(UsageError, match=f"observation is .*{message}|{message}") as caught:
        Observations("Robot", observed).rows(raw)
    assert "or a batch of them" in str(caught.value)
