"""What holds of any action space, any numbers and any file, by examples that hypothesis looks for."""

import json
import math

import gymnasium
import jax
import numpy as np
import pytest
from gymnasium.spaces import Box, Dict, Discrete, MultiBinary, MultiDiscrete, Tuple
from hypothesis import example, given, settings, target
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

import galton
from galton import CheckpointError, UsageError
from galton.agents import read
from galton.envs.host.actions import Actions
from galton.envs.host.observations import Observations
from galton.envs.host.space_json import from_json, to_json
from galton.saving import checkpoint
from galton.training.yardsticks import at_random
from galton.words import vocabulary

DTYPES = st.sampled_from([np.float16, np.float32, np.float64])
SHAPES = hnp.array_shapes(min_dims=0, max_dims=3, max_side=4)


@st.composite
def boxes(draw):
    """Boxes of actions as environments may have them: narrow, wide, lopsided, unbounded, without width."""
    dtype, shape = draw(DTYPES), draw(SHAPES)
    numbers = hnp.arrays(dtype, shape, elements=st.floats(width=8 * np.dtype(dtype).itemsize, allow_nan=False))
    first, second = draw(numbers), draw(numbers)
    low, high = np.minimum(first, second), np.maximum(first, second)
    with np.errstate(all="ignore"):
        return Box(low, high, shape, dtype)


@pytest.mark.filterwarnings("ignore:.*:UserWarning")
@given(boxes(), st.data())
def test_a_box_is_refused_or_every_action_lies_in_it_in_its_own_type(space, data):
    try:
        box = Actions("it", space)
    except UsageError:
        return
    d = math.prod(space.shape)
    assert (box.low <= box.high).all()
    assert box.box.choices == tuple(np.flatnonzero(box.low == box.high))
    assert np.isfinite([box.low, box.high]).all()
    actions = data.draw(hnp.arrays(np.float32, (3, d), elements=st.floats(width=32, allow_nan=False)))
    target(float(np.log1p(np.abs(actions[np.isfinite(actions)]).max(initial=0))))
    there = box.to_env(actions)
    assert (there.shape, there.dtype) == ((3, *space.shape), space.dtype)
    for action in there:
        assert space.contains(action)
    for i in box.box.numbers:
        bins = galton.Bins(box.low[i], box.high[i], 7)
        assert (bins.centers >= box.low[i]).all()
        assert (bins.centers <= box.high[i]).all()


def spaces():
    """What an environment may show, with spaces in spaces."""
    finite = st.floats(-1e6, 1e6, width=32)
    flat = st.one_of(
        st.builds(lambda a, b, shape: Box(min(a, b), max(a, b), shape), finite, finite, SHAPES),
        st.builds(lambda n, start: Discrete(n, start=start), st.integers(1, 9), st.integers(-9, 9)),
        st.builds(lambda nvec: MultiDiscrete(nvec), st.lists(st.integers(1, 5), min_size=1, max_size=3)),
        st.builds(MultiBinary, st.integers(1, 5)),
    )
    names = st.text(min_size=1, max_size=3)
    return st.recursive(
        flat,
        lambda inner: (
            st.builds(Dict, st.dictionaries(names, inner, min_size=1, max_size=3))
            | st.builds(lambda parts: Tuple(parts), st.lists(inner, min_size=1, max_size=3))
        ),
        max_leaves=4,
    )


@given(spaces(), st.integers(0, 2**31))
def test_a_space_comes_back_from_a_file_and_its_samples_are_flat_numbers(space, seed):
    again = from_json(json.loads(json.dumps(to_json(space))))
    assert again == space
    assert to_json(again) == to_json(space)
    space.seed(seed)
    sample = space.sample()
    observations = Observations("it", space)
    flat = observations.flatten(sample, "it")
    assert (flat.shape, flat.dtype) == ((observations.size,), np.float32)
    np.testing.assert_array_equal(flat, gymnasium.spaces.flatten(space, sample).astype(np.float32))


@given(spaces())
def test_whatever_a_policy_draws_is_in_the_space(space):
    try:
        actions = Actions("it", space)
    except UsageError:
        return
    box = actions.box
    rows = at_random(box)(np.zeros((5, 1)))
    rows[0], rows[1] = box.low, box.high
    taken = actions.to_env(rows)
    for i in range(len(rows)):
        assert space.contains(actions.one(taken, i))
    assert len(box.told) == len(box.low)


NUMBERS = st.floats() | st.sampled_from([0.0, -0.0, 1.0, 1e-45, 1e-30, 3e38, math.inf, -math.inf, math.nan, 0.5, 2.0])
WORDS = {"loss": "gaussian", "n_steps": 5, "net_arch": ()}


def is_of_use(name):
    """Whether this agent has a use for the number; others are refused by name."""
    try:
        read(WORDS | {name: 1.0 if name == "box_units" else 0.3})
    except UsageError:
        return False
    return True


ROWS = st.fixed_dictionaries(
    {}, optional=dict.fromkeys(filter(is_of_use, filter(vocabulary().is_number, vocabulary().usual)), NUMBERS)
)
N_RUNS = 8


@pytest.mark.slow
@settings(max_examples=10)
@given(st.lists(ROWS, min_size=N_RUNS, max_size=N_RUNS))
@example([{"learning_rate": 3e38}] * N_RUNS)
@example([{"eta": 1e-45, "max_grad_norm": 1e-45, "log_std_init": -100.0, "log_std_min": -math.inf}] * N_RUNS)
def test_numbers_that_are_taken_train_or_diverge_and_what_is_kept_is_finite(rows):
    """Whatever numbers pass the check: no other error, and no run that is neither finite nor called diverged."""
    taken = []
    for row in rows:
        try:
            read(WORDS | row)
            taken.append(read(WORDS | row | {"box_units": 0.0, "noise_correlation": 0.0}))  # else of other programs
        except UsageError:
            assert row
    taken += [read(WORDS)] * (N_RUNS - len(taken))
    with np.errstate(over="ignore"):
        agent = jax.tree.map(lambda *numbers: np.float32(numbers), *taken)
    result = galton.train("bandit", agent, range(N_RUNS), 20, n_logs=1, n_eval_episodes=1)
    for leaf in jax.tree.leaves(result.learner.params):
        finite = np.isfinite(leaf).reshape(N_RUNS, -1).all(1)
        assert (finite | (result.diverged_at >= 0)).all()


@pytest.fixture(scope="module")
def place(tmp_path_factory):
    """A folder that examples write into, one after the other."""
    return tmp_path_factory.mktemp("place")


KINDS = [np.float32, np.float64, np.int32, np.uint8, np.uint32, np.int64, np.bool_]
ARRAYS = st.dictionaries(
    st.text(min_size=1, max_size=8), st.sampled_from(KINDS).flatmap(lambda kind: hnp.arrays(kind, SHAPES)), max_size=4
)
JSON = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats(allow_nan=False) | st.text(),
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(st.text(max_size=5), inner, max_size=3),
    max_leaves=8,
)


@settings(max_examples=40)
@given(st.dictionaries(st.text(max_size=5), JSON, max_size=4), ARRAYS, st.data())
def test_a_checkpoint_comes_back_as_it_was_and_with_any_byte_changed_not_at_all(place, kept, arrays, data):
    path = place / "file"
    checkpoint.write(path, kept, arrays)
    again, found = checkpoint.read(path)
    assert json.dumps(again) == json.dumps(kept)
    assert {name: (array.tobytes(), array.dtype, array.shape) for name, array in found.items()} == {
        name: (array.tobytes(), array.dtype, array.shape) for name, array in arrays.items()
    }
    content = bytearray(path.read_bytes())
    changed = data.draw(st.integers(0, len(content) - 1))
    content[changed] ^= data.draw(st.integers(1, 255))
    path.write_bytes(content)
    with pytest.raises(CheckpointError):
        checkpoint.read(path)
