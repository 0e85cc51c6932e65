from collections import OrderedDict

import numpy as np
import pytest
from gymnasium.spaces import Box, Dict, Discrete, Graph, MultiBinary, MultiDiscrete, OneOf, Sequence, Text, Tuple
from gymnasium.spaces.utils import flatten
from gymnasium.vector.utils import batch_space, concatenate, create_empty_array

from galton import BrokenEnvironmentError, UsageError
from galton.envs.host.observations import Observations
from galton.envs.host.space_json import from_json, to_json

from .walks import UNIT, box

OBSERVATIONS = {
    "vector": Box(-1, 1, (3,)),
    "unbounded": Box(-np.inf, np.inf, (3,), np.float64),
    "large integers": Box(0, 2**40, (2,), np.int64),
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
        assert flat.dtype == (np.float64 if str(space).startswith("Box") and "t64" in str(space) else np.float32)
        assert flat.shape == (observations.size,)
        np.testing.assert_array_equal(flat, np.asarray(flatten(space, raw)))


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
    again, raw = from_json(to_json(space)), space.sample()
    assert again == space
    ours, theirs = (Observations("Robot", each).flatten(raw, "here") for each in (again, space))
    np.testing.assert_array_equal(ours, theirs)


def test_bounds_come_back_from_a_file_exactly():
    for dtype in (np.float32, np.float64):
        space = box([[-0.1, -np.inf, 1 / 3]], [[np.inf, 0.7, 1e30]], dtype)
        again = from_json(to_json(space))
        assert again == space
        assert (again.shape, again.dtype) == (space.shape, space.dtype)


def test_observations_without_a_fixed_size_or_of_nothing_are_refused():
    one_of, dicted, tupled = OneOf([UNIT, Discrete(2)]), Dict(a=UNIT, words=Text(5)), Tuple([UNIT, Sequence(UNIT)])
    for space in (Text(5), Sequence(UNIT), Graph(UNIT, None), one_of, dicted, tupled):
        with pytest.raises(UsageError, match=r"Robot observes .*can be flattened: wrap the environment .*s a Box"):
            Observations("Robot", space)
    for empty in (Box(-1, 1, (0,)), Dict(), Tuple([])):
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


def test_a_part_that_does_not_fit_is_named():
    observations = Observations("Robot", PARTS)
    observations.flatten(GOOD, "here")
    for raw, message in WRONG.values():
        with pytest.raises(BrokenEnvironmentError, match=f"^Robot, copy 2, step 7: .*{message}"):
            observations.flatten(raw, "Robot, copy 2, step 7")


def test_predict_refuses_what_the_space_can_not_hold():
    for observed, raw, message in (
        (Box(-1, 1, (3,)), np.zeros(4), r"its shape is \(4,\)"),
        (Box(-1, 1, (3,)), np.zeros((2, 2, 3)), r"its shape is \(2, 2, 3\)"),
        (Box(-1, 1, (3,)), ["a", "b", "c"], "its type is <U1"),
        (Box(-1, 1, (3,)), [[1], [2, 3]], "observation is"),
        (Box(-1, 1, (3,)), [0, np.nan, 0], r"entry \[1\] of it is nan"),
        (Box(-1, 1, (3,)), None, "observation is None"),
        (PARTS, GOOD | {"a": [0.5]}, "which must have shape"),
        (PARTS, None, "observation is None"),
        (Dict(a=Box(-1, 1, (2,)), b=Discrete(3)), {"a": np.zeros((3, 2)), "b": [0, 1]}, r"batches of \[2, 3\]"),
    ):
        with pytest.raises(UsageError, match=f"observation is .*{message}|{message}") as caught:
            Observations("Robot", observed).rows(raw)
        assert "or a batch of them" in str(caught.value)
