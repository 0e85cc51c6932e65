"""Figures drawn from sweeps that nobody trained: what stands in them is what went in."""

import dataclasses

import numpy as np
import pytest

from galton.losses import LOSSES
from galton.tasks import TASKS
from galton.training.log import MEAN_ACTION_RETURN
from studies.paper.bandit import DIMENSION, NOISE
from studies.paper.registry import FIGURES
from studies.paper.trained import Trained

from . import made_up

ENDS = {"gaussian": 1.0, "hl-one-hot": 2.0, "hl-gauss": 3.0, "hl-gauss-centred": 4.0}


@pytest.fixture(scope="module")
def data():
    return made_up.data(lambda name, setting: ENDS[setting["loss"]] - (name == "bandit-noise-10"))


def names_in(axes):
    return [line.get_gid() for line in axes.get_lines()]


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
        assert all(panel.lines or panel.collections or panel.texts for panel in panels)


@pytest.mark.parametrize("name", ["figure-2", "figure-8", "figure-9"])
def test_learning_curves_are_means_over_the_winners_trials_on_fresh_seeds(name, data):
    study = FIGURES[name]
    figure = study.draw(data)
    metric = "evaluation_return" if name == "figure-8" else "training_return"
    tasks = [sweep.name for sweep in study.sweeps if sweep.name in TASKS]
    for axes, task in zip(figure.axes, tasks, strict=True):
        assert axes.get_title() == f"{TASKS[task].title} (d = {TASKS[task].d}), n = {data.grids[task].study.trials}"
        summary = data.judged[task].again
        for loss, best in summary.best.items():
            curves = summary.curves(metric)[summary.rows(best.setting)]
            np.testing.assert_allclose(named(axes, LOSSES[loss].label).get_ydata(), curves.mean(0))


def test_without_fresh_seeds_the_grids_winners_are_shown_and_named_so(data):
    (axes,) = FIGURES["figure-2"].draw(Trained({"lqr": data.sweeps["lqr"]})).axes
    assert axes.get_title().endswith(", of the grid")
    summary = data.sweeps["lqr"]
    curves = summary.curves("training_return")[summary.rows(summary.best["gaussian"].setting)]
    np.testing.assert_allclose(named(axes, "Gaussian").get_ydata(), curves.mean(0))


def test_the_mean_actions_return_is_drawn_where_it_was_logged(data):
    summary = data.sweeps["lqr-again"]
    assert not any("mean action" in name for name in names_in(FIGURES["figure-8"].draw(data).axes[1]))
    curve = summary.table.column("evaluation_return")
    logged = dataclasses.replace(summary, table=summary.table.append_column(MEAN_ACTION_RETURN, curve))
    (axes,) = FIGURES["figure-8"].draw(Trained({"lqr": data.sweeps["lqr"], "lqr-again": logged})).axes
    told = [name for name in names_in(axes) if "mean action" in name]
    assert told == [f"{LOSSES[loss].label}: mean action" for loss in summary.best if loss != "gaussian"]


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
