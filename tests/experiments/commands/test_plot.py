"""The curves of runs are what their logs hold."""

import json

import pytest
from matplotlib.figure import Figure

from galton import UsageError
from galton_experiments.commands import plot


def log(folder, *points):
    folder.mkdir()
    (folder / "metrics.jsonl").write_text("".join(json.dumps(point) + "\n" for point in points))
    return str(folder)


def point(step, training, evaluation=None):
    return {"time/total_timesteps": step, "rollout/ep_rew_mean": training, "eval/mean_reward": evaluation}


@pytest.fixture
def drawn(monkeypatch):
    """The figure that was written last."""
    kept = []
    monkeypatch.setattr(plot, "images", lambda figure: kept.append(figure) or {".png": b"picture"})
    return kept


def test_each_run_is_a_curve_of_what_is_known_of_it(tmp_path, drawn, capsys):
    one = log(tmp_path / "one", point(100, -3.0, -2.0), point(200, None, -1.0))
    other = log(tmp_path / "other", point(50, 1.0))
    plot.main([one, other, "--out", str(tmp_path / "a.png")])
    (figure,) = drawn
    assert isinstance(figure, Figure)
    lines = [{line.get_label(): line.get_xydata().tolist() for line in axes.lines} for axes in figure.axes]
    assert lines == [{one: [[100, -3]], other: [[50, 1]]}, {one: [[100, -2], [200, -1]], other: []}]
    assert (tmp_path / "a.png").read_bytes() == b"picture"
    assert capsys.readouterr().out == f"figure: {tmp_path / 'a.png'}\n"


@pytest.mark.parametrize(
    ("arguments", "told"),
    [
        (["nowhere"], "run is nowhere, which holds no metrics.jsonl"),
        ([__file__], r"run is .*test_plot\.py, which holds no metrics\.jsonl .*; name a run folder"),
        (["x", "--out", "a.pdf"], "must end in .png or .svg"),
    ],
)
def test_what_cannot_be_drawn_is_told(arguments, told):
    with pytest.raises(UsageError, match=told):
        plot.main(arguments)


def test_every_run_of_many_is_seen_and_named(tmp_path, drawn, monkeypatch):
    monkeypatch.chdir(tmp_path)
    runs = [log(tmp_path / f"_{i}", point(100, i)).rpartition("/")[2] for i in range(10)]
    plot.main([*runs, "--out", "a.png"])
    (axes,) = drawn[0].axes
    assert {line.get_label() for line in axes.lines} == {f"./{run}" for run in runs}
    assert len({(line.get_color(), line.get_linestyle()) for line in axes.lines}) == 10
    assert all(line.get_marker() == "o" for line in axes.lines)  # one point makes no line


def test_runs_without_a_return_make_no_figure(tmp_path):
    young = log(tmp_path / "young", point(100, None))
    with pytest.raises(UsageError, match="no episode has ended yet"):
        plot.main([young, "--out", str(tmp_path / "a.png")])
    assert not (tmp_path / "a.png").exists()
