"""Figures drawn from sweeps that nobody trained: what stands in them is what went in."""

import numpy as np
import pytest

from galton.analysis.plots import RUN
from galton.losses import LOSSES
from galton.paper.bandit import DIMENSION, NOISE
from galton.paper.registry import FIGURES
from galton.paper.trained import Trained
from galton.tasks import TASKS

from . import made_up

ENDS = {"gaussian": 1.0, "hl-one-hot": 2.0, "hl-gauss": 3.0, "hl-gauss-centred": 4.0}


@pytest.fixture(scope="module")
def data():
    return made_up.data(lambda name, setting: ENDS[setting.config.loss] - (name == "bandit-noise-10"))


def named(axes, name):
    (line,) = [line for line in axes.get_lines() if line.get_gid() == name]
    return line


SWEPT = [name for name in FIGURES if FIGURES[name].sweeps]


@pytest.mark.parametrize("name", SWEPT)
def test_a_figure_draws_any_part_of_its_sweeps(name, data):
    study = FIGURES[name]
    assert study.draw(data).axes
    for sweep in study.sweeps:
        panels = study.draw(Trained({sweep.name: data.sweeps[sweep.name]})).axes
        assert all(panel.lines or panel.collections for panel in panels)


@pytest.mark.parametrize("name", ["figure-2", "figure-8", "figure-9"])
def test_learning_curves_are_means_over_the_winners_trials(name, data):
    study = FIGURES[name]
    figure = study.draw(data)
    metric = "evaluation_return" if name == "figure-8" else "training_return"
    tasks = [sweep.name for sweep in study.sweeps if sweep.name in TASKS]
    for axes, task in zip(figure.axes, tasks, strict=True):
        assert TASKS[task].title in axes.get_title()
        summary = data.sweeps[task]
        for loss, best in summary.best.items():
            curves = summary.curves(metric)[summary.rows(best.setting)]
            np.testing.assert_allclose(named(axes, LOSSES[loss].label).get_ydata(), curves.mean(0))
            assert sum(line.get_gid() == RUN + LOSSES[loss].label for line in axes.get_lines()) == len(curves)


def test_figure_3_shows_final_returns_by_noise_and_dimension(data):
    noise, dimension, *_ = FIGURES["figure-3"].draw(data).axes
    for loss in ("gaussian", "hl-gauss"):
        line, end = named(noise, LOSSES[loss].label), ENDS[loss]
        assert list(line.get_xdata()) == sorted(NOISE)
        np.testing.assert_allclose(line.get_ydata()[:-1], end, atol=0.1)
        assert line.get_ydata()[-1] == pytest.approx(end - 1, abs=0.1)
        assert list(named(dimension, LOSSES[loss].label).get_xdata()) == sorted(DIMENSION)


def test_a_profile_falls_from_all_to_none(data):
    for axes in FIGURES["figure-7"].draw(data).axes:
        for loss in ENDS:
            share = named(axes, LOSSES[loss].label).get_ydata()
            assert (np.diff(share) <= 0).all()
            assert share[-1] == 0
    assert named(axes, LOSSES["hl-gauss-centred"].label).get_ydata()[0] == 1
