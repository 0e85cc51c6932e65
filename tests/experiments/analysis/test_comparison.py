import dataclasses
import functools
import json

import jax
import numpy as np
import pytest

from galton import make_agent, train
from galton.envs import LQR, MountainCar
from galton_experiments.analysis.comparison import curves, learning_curves, summarise, verdicts
from galton_experiments.analysis.plain import plain
from galton_experiments.analysis.plots import save

SMALL = {"n_bins": 4, "net_arch": (), "n_steps": 5}


@functools.cache
def trained():
    return train(LQR(), make_agent(**SMALL), range(12), 20, n_logs=2, n_eval_episodes=1)


def result(loss, final, diverged=()):
    """A real result, up to twelve runs, as if it were this loss's; with the returns of its log points set by hand."""
    real, n = trained(), len(final)
    first = {name: jax.tree.map(lambda x: x[:n], getattr(real, name)) for name in ("seeds", "log", "learner")}
    column = np.array(final, np.float32)[:, None].repeat(2, 1)
    first["log"] = first["log"]._replace(training_return=column, evaluation_return=column + 1)
    flags = np.where(np.isin(np.arange(n), diverged), 10, -1)
    return dataclasses.replace(real, agent=make_agent(loss=loss, **SMALL), diverged_at=flags, **first)


@pytest.fixture(scope="module")
def results():
    return {
        "gaussian": result("gaussian", [-20.0, -21.0, -22.0, -900.0], diverged=[3]),
        "hl-gauss": result("hl-gauss", [-11.0, -10.0, -12.0, -11.0]),
        "hl-one-hot": result("hl-one-hot", [-20.0, -22.0, -21.0, -21.0]),
    }


@pytest.mark.slow
def test_rows_leave_diverged_runs_out_of_the_means_and_count_them(results):
    rows = {row.loss: row for row in summarise(results, LQR())}
    assert rows["gaussian"].training_return.mean == -21
    assert rows["gaussian"].diverged == 1
    assert rows["hl-gauss"].evaluation_return.mean == -10


def test_a_row_is_json_with_null_for_what_is_not_known():
    (row,) = summarise({"gaussian": result("gaussian", [-3.0])}, MountainCar())
    record = json.loads(json.dumps(plain(row), allow_nan=False))
    assert record["training_return"] == {"mean": -3.0, "low": None, "high": None}
    assert record["rest_to_optimum"] is None


def test_a_curve_ends_where_its_run_diverged():
    both = {"gaussian": result("gaussian", [-20.0, -900.0], diverged=[1])}
    (line, *_) = learning_curves(both, LQR(), "LQR").axes[0].lines
    np.testing.assert_array_equal(line.get_ydata(), [-20.0, -20.0])


def test_the_share_of_the_optimum_is_zero_at_random_and_one_at_the_optimum():
    env = LQR()
    for value, share in ((env.random_return, 0.0), (env.optimal_return, 1.0)):
        (row,) = summarise({"gaussian": result("gaussian", [value - 1, value - 1])}, env)
        assert row.rest_to_optimum == pytest.approx(share, abs=1e-6)


def test_where_doing_nothing_is_worth_more_than_random_actions_it_is_zero():
    env = LQR()
    halfway = (env.optimal_return - 26.03) / 2
    (row,) = summarise({"gaussian": result("gaussian", [halfway - 1] * 2)}, env, at_rest=-26.03)
    assert row.rest_to_optimum == pytest.approx(0.5)
    (row,) = summarise({"gaussian": result("gaussian", [env.random_return - 1] * 2)}, env, at_rest=-1e6)
    assert row.rest_to_optimum == pytest.approx(0, abs=1e-6)


def test_without_a_known_optimum_there_is_no_share(results):
    rows = summarise(results, MountainCar())
    assert all(row.rest_to_optimum is None for row in rows)


def test_verdicts_name_what_differs_and_what_does_not():
    base = np.linspace(-21.0, -20.0, 12)
    results = {
        "gaussian": result("gaussian", base),
        "hl-gauss": result("hl-gauss", base + np.linspace(9.5, 10.5, 12)),
        "hl-one-hot": result("hl-one-hot", base + 0.1 * (-1.0) ** np.arange(12)),
    }
    sentences = verdicts(results)
    assert [s.rsplit(": ", 1)[1] for s in sentences] == ["better", "no clear difference"] * 2
    assert sentences[0].startswith("HL-Gauss − Gaussian, training return: +10.00 ±")
    assert verdicts({"hl-gauss": results["hl-gauss"]}) == []


def test_a_loss_whose_runs_diverge_is_not_better_by_the_others(results):
    base = np.linspace(4.0, 6.0, 10)
    known = {
        "gaussian": result("gaussian", base),
        "hl-gauss": result("hl-gauss", base + 5, diverged=range(3, 10)),
        "hl-one-hot": result("hl-one-hot", base - 3, diverged=range(3, 10)),
    }
    assert [s.rsplit(": ", 1)[1] for s in verdicts(known)] == ["no clear difference", "worse"] * 2
    assert {s.rsplit(": ", 1)[1] for s in verdicts(results)} == {"too few runs"}  # four runs, four decisions
    three = {loss: result(loss, [1.0, 2.0, 3.0]) for loss in ("gaussian", "hl-gauss")}
    assert {s.rsplit(": ", 1)[1] for s in verdicts(three)} == {"too few runs"}


def test_a_diverged_run_is_below_the_worst_that_did_not_diverge():
    base = [-500.0] * 8 + [-100.0] * 4
    known = {"gaussian": result("gaussian", base), "hl-gauss": result("hl-gauss", base, diverged=range(12))}
    assert [s.rsplit(": ", 1)[1] for s in verdicts(known)] == ["worse"] * 2
    assert verdicts(known)[0].startswith("HL-Gauss − Gaussian, training return: −133.3")


def test_a_run_in_which_no_episode_ended_is_unknown_and_no_worst_run():
    known = {
        "gaussian": result("gaussian", [np.nan] * 8),
        "hl-gauss": result("hl-gauss", np.linspace(1.0, 2.0, 8)),
    }
    assert [s.rsplit(": ", 1)[1] for s in verdicts(known)] == ["too few runs"] * 2


def test_curves_hold_every_run_and_log_point(results):
    frame = curves(results).to_pydict()
    assert len(frame["loss"]) == 3 * 4 * 2
    assert set(frame["loss"]) == set(results)
    assert frame["seed"][:4] == [0, 0, 1, 1]
    assert frame["step"][:4] == [10, 20, 10, 20]
    assert frame["evaluation_return"][0] == -19


@pytest.mark.slow
def test_the_same_figure_gives_the_same_files(results, tmp_path):
    for name in ("a", "b"):
        save(learning_curves(results, LQR(), "LQR"), tmp_path / name)
    for suffix in (".png", ".svg"):
        first, second = ((tmp_path / name).with_suffix(suffix).read_bytes() for name in ("a", "b"))
        assert first == second
        assert len(first) > 5_000


def test_a_preset_is_told_with_its_loss_and_is_the_baseline_where_that_is_the_gaussians(tmp_path):
    names = ["hl-gauss-centred, preset best", "gaussian, preset gaussian"]
    of_presets = {name: result(name.partition(",")[0], [-9.0, -8.0, -7.5, -7.0]) for name in names}
    line, _ = verdicts(of_presets)
    assert line.startswith("Centred HL-Gauss (ours), preset best − Gaussian, preset gaussian, training return: +0.00")
    lines = learning_curves(of_presets, LQR(), "LQR").axes[0].lines
    assert {"Centred HL-Gauss (ours), preset best", "Gaussian, preset gaussian"} < {line.get_label() for line in lines}
    two = {f"gaussian, preset {preset}": result("gaussian", [-9.0, -8.0]) for preset in ("gaussian", "playground")}
    first, second, *_ = learning_curves(two, None, "LQR").axes[0].lines
    assert first.get_color() != second.get_color()
