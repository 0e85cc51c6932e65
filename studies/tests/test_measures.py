import numpy as np
import pytest

from studies.paper.measures import apart, drawdown, over_training, steps_to
from studies.paper.trained import Scale

from . import made_up
from .test_claims import with_curves, with_finals

TRIALS = 3


@pytest.fixture(scope="module")
def data():
    return made_up.judgeable(lambda *_: 1.0, ("lqr", "lqr-again"), trials=TRIALS)


def having(data, curves):
    """The sweep of fresh seeds where the Gaussian's trials have these curves."""
    summary = data.sweeps["lqr-again"]
    whole = np.zeros((len(summary.setting), 6))
    whole[summary.rows(summary.best["gaussian"].setting)] = curves
    return with_curves(data, "lqr-again", "training_return", whole)


def test_the_first_log_point_at_a_level_and_what_never_gets_there(data):
    curves = [[0, 1, 5, 0, 9, 9], [5, 0, 0, 0, 0, 0], [0, 0, 0, 0, 0, 4.9]]
    summary = having(data, curves).sweeps["lqr-again"]
    steps = summary.steps
    np.testing.assert_array_equal(steps_to(summary, "gaussian", 5.0), [steps[2], steps[0], steps[-1] + steps[0]])


def test_drawdown_is_what_is_lost_of_the_best_log_point(data):
    curved = having(data, [[0, 1, 5, 0, 4, 4], [5, 0, 0, 0, 0, 0], [0, 0, 0, 0, 0, 4]])
    ended = with_finals(curved, "lqr-again", "training_return", ["gaussian"], lambda _: np.array([4.0, 0.0, 4.0]))
    lost = drawdown(ended.sweeps["lqr-again"], "gaussian", Scale(-10.0, 0.0))
    np.testing.assert_allclose(lost, [0.1, 0.5, 0.0])


def test_apart_is_the_distance_from_the_median(data):
    spread = with_finals(data, "lqr-again", "training_return", ["gaussian"], lambda _: np.array([4.0, 0.0, 7.0]))
    np.testing.assert_allclose(apart(spread.sweeps["lqr-again"], "gaussian"), [0, 4, 3])


def test_the_mean_over_training_of_each_setting(data):
    grid = data.sweeps["lqr"]
    found = over_training(grid)
    assert [*found] == [*grid.study.settings]
    for setting, mean in found.items():
        assert mean == pytest.approx(grid.curves("training_return")[grid.rows(setting)].mean())
