import numpy as np
import pytest

from galton import A2C, UsageError

from .tall import Tall

SMALL = {"preset": "paper", "n_bins": 10, "net_arch": (8,)}


@pytest.fixture(scope="module")
def tall():
    return A2C(Tall, **SMALL)


@pytest.fixture(scope="module")
def gaussian():
    return A2C(Tall, "gaussian", net_arch=(8,))


@pytest.mark.slow
@pytest.mark.parametrize("name", ["tall", "gaussian"])
@pytest.mark.parametrize("deterministic", [True, False])
def test_actions_have_the_shape_and_type_of_the_space_and_lie_in_it(name, deterministic, request):
    model = request.getfixturevalue(name)
    space = model.action_space
    single, state = model.predict(np.zeros((2, 3), np.float32), state=("kept",), deterministic=deterministic)
    assert (single.shape, single.dtype) == (space.shape, space.dtype)
    assert state == ("kept",)
    for n in (0, 1, 64):
        batch, _ = model.predict(np.zeros((n, 2, 3), np.float32), deterministic=deterministic)
        assert (batch.shape, batch.dtype) == ((n, 2, 2), space.dtype)
        assert all(space.contains(action) for action in batch)


def test_a_batch_gives_what_its_rows_give(tall):
    observations = np.random.default_rng(0).uniform(-1, 1, (5, 2, 3)).astype(np.float32)
    batch, _ = tall.predict(observations, deterministic=True)
    for row, action in zip(observations, batch, strict=True):
        np.testing.assert_allclose(tall.predict(row, deterministic=True)[0], action, rtol=1e-6)


def test_stochastic_predictions_differ_from_call_to_call_and_deterministic_ones_do_not(tall):
    observations = np.zeros((16, 2, 3), np.float32)
    draws = [tall.predict(observations)[0] for _ in range(2)]
    assert (draws[0] != draws[1]).any()
    assert (draws[0][0] != draws[0]).any()
    best = [tall.predict(observations, deterministic=True)[0] for _ in range(2)]
    np.testing.assert_array_equal(*best)


def test_a_histogram_takes_bin_centers_and_a_gaussian_is_clipped_into_the_box(tall, gaussian):
    observations = np.zeros((500, 2, 3), np.float32)
    low, high = tall.action_space.low, tall.action_space.high
    bins = (tall.predict(observations)[0] - low) / (high - low) * 10 - 0.5
    np.testing.assert_allclose(bins, bins.round(), atol=1e-4)
    assert set(bins.round().astype(int).ravel()) == set(range(10))
    actions, _ = gaussian.predict(observations)
    assert (actions == low).any()
    assert (actions == high).any()
    assert ((actions > low) & (actions < high)).any()


def test_every_seed_can_predict_and_an_observation_that_does_not_fit_is_refused():
    for seed in (0, 2**31, 2**32 - 1):
        model = A2C("lqr", **SMALL, seed=seed)
        assert model.predict(np.zeros(2))[0].shape == (2,)
    for wrong in (
        np.zeros(3),
        np.zeros((1, 1, 2)),
        np.zeros(()),
        np.zeros((2, 3)),
        "ab",
        None,
        [[0], [0, 1]],
        [np.nan, 0],
    ):
        with pytest.raises(UsageError, match="observation is"):
            model.predict(wrong)
