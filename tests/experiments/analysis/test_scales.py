import numpy as np
import pytest

from galton_experiments.analysis.plots import panels
from galton_experiments.analysis.scales import fit_curves, from_best, round_numbers
from galton_experiments.analysis.statistics import Interval


def curve(*values):
    return Interval(*[np.array(values, float)] * 3)


def shares(axes, values):
    """How high values are drawn, from 0 to 1."""
    points = np.stack([np.zeros(len(values)), values], axis=1)
    return (axes.get_yaxis_transform() - axes.transAxes).transform(points)[:, 1]


def test_what_early_training_would_flatten_takes_a_good_part_of_the_axis():
    _, (axes,) = panels(1)
    fit_curves(axes, [curve(-150, -50, -26, -24), curve(-100, -30, -15, -13)], [-9.8])
    first, late, best = shares(axes, [-150, -24, -9.8])
    assert 0 < first < 0.1
    assert best - late > 0.35  # a linear axis would give it a tenth
    assert best < 1


def test_curves_that_rise_all_along_have_a_linear_axis_with_room_for_their_bands():
    _, (axes,) = panels(1)
    fit_curves(axes, [Interval(np.arange(5.0), np.arange(5.0) - 1, np.arange(5.0) + 1)])
    assert axes.get_yscale() == "linear"
    low, high = axes.get_ylim()
    assert low < 0 < 5 <= high
    fit_curves(axes, [Interval(np.arange(5.0), np.arange(5.0), np.arange(5.0) + 100)])
    assert axes.get_ylim()[1] < 6  # but not for one run's success


def test_nothing_known_leaves_the_axis_alone():
    _, (axes,) = panels(1)
    for curves in ([], [curve(np.nan, np.nan)], [curve(1, 1)]):
        fit_curves(axes, curves)
        assert axes.get_ylim() == (0, 1)


def test_distances_are_in_proportion_near_the_best_and_logarithmic_far_from_it():
    _, (axes,) = panels(1)
    from_best(axes, "y", 10.0, 1.0, (-1e6, 11.0))
    near = shares(axes, [10, 9.99, 9.98, 9.97])
    np.testing.assert_allclose(np.diff(near), np.diff(near)[0], rtol=0.03)
    far = shares(axes, [-1e3, -1e4, -1e5])
    np.testing.assert_allclose(np.diff(far), np.diff(far)[0], rtol=0.02)
    np.testing.assert_allclose(shares(axes, [-1e6, 11]), [0, 1], atol=1e-9)


def test_ticks_are_round_and_apart():
    def scale(values):
        return -np.log1p(25 - np.asarray(values, float))

    found = round_numbers(scale, (-33.0, 25.0), 0.12)
    assert {-0.0, 20.0, 24.0} <= {*found}
    assert len(found) >= 4
    places = (scale(found) - scale(-33.0)) / (scale(25.0) - scale(-33.0))
    assert np.diff(places).min() >= 0.12
    assert round_numbers(lambda values: np.asarray(values), (0.0, 1.0), 0.3) == pytest.approx([0, 0.5, 1])


def test_one_curve_that_falls_does_not_flatten_the_others():
    _, (axes,) = panels(1)
    fit_curves(axes, [curve(-150, -15, -70, -90), curve(-100, -26, -24, -23), curve(-100, -27, -24, -22)], [-9.8])
    worst, late, best = shares(axes, [-23.5, -22, -9.8])
    assert late - worst > 0.015
    assert best - late > 0.2
