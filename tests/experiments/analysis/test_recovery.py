"""Times until runs are back after a change, counted by hand, and what scipy makes of them."""

import numpy as np
import pytest
from scipy import stats

from galton_experiments.analysis import recoveries

STEPS = np.arange(10, 100, 10)
RETURNS = np.array(
    [
        [0.9, 0.9, 0.9, 0.1, 0.8, 0.9, 0.2, 0.9, 0.9],  # back after 20, then after 20
        [0.9, 0.9, 0.9, 0.1, 0.2, 0.9, 0.2, 0.2, 0.9],  # not before the change at 60, where it is luck; nor then
        [0.9, 0.9, 0.9, 0.9, 0.2, 0.3, 0.9, 0.2, 0.9],  # at once, both times
    ]
)


def test_times_are_counted_from_each_change_and_end_before_the_next():
    first, second = recoveries(RETURNS, STEPS, 30, 0.8)
    for found in (first, second):
        np.testing.assert_array_equal(np.sort(found._uncensored), [10, 20])
        np.testing.assert_array_equal(found._right, [20])


def test_a_curve_of_scipys_is_kaplan_and_meiers():
    survival = stats.ecdf(recoveries(RETURNS, STEPS, 30, 0.8)[1]).sf
    assert survival.evaluate(5) == 1
    assert survival.evaluate(15) == pytest.approx(2 / 3)
    assert survival.evaluate(25) == pytest.approx(1 / 3)


def test_a_change_behind_which_nothing_was_logged_has_no_entry():
    assert len(recoveries(RETURNS, STEPS, 80, 0.8)) == 1
    assert recoveries(RETURNS, STEPS, 95, 0.8) == []
