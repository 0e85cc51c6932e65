"""What a sweep shows while it runs."""

import time

from rich.console import Console

from galton_experiments.sweep.grid import expand
from galton_experiments.sweep.plan import Plan
from galton_experiments.sweep.shard import Report
from galton_experiments.sweep.study import Study
from galton_experiments.sweep.view import View

SETTINGS = expand([{"loss": "gaussian", "learning_rate": [0.1, 0.2]}], {})


def report(setting, value):
    return Report(0, [setting], [value], steps=100, train_seconds=1.0)


def shown(view):
    console = Console(width=120)
    with console.capture() as capture:
        console.print(view)
    return capture.get()


def test_a_setting_that_diverged_is_not_the_best_so_far(monkeypatch):
    view = View(Plan.create(Study("bandit", SETTINGS, 1, 100)))
    view.tell([report(0, float("nan"))], False)
    assert "nan" not in shown(view)
    view.tell([report(1, -3.0)], False)
    assert "learning rate 0.2" in shown(view)
    assert "-3.00" in shown(view)


def test_the_best_so_far_has_lost_the_fewest_runs_and_then_the_highest_mean(monkeypatch):
    view = View(Plan.create(Study("bandit", SETTINGS, 2, 100)))
    for i, value in ((0, 5.0), (0, float("nan")), (1, -3.0), (1, float("nan"))):
        view.tell([report(i, value)], False)
    assert "learning rate 0.1" in shown(view)
    view.tell([report(1, -4.0)], False)
    assert "learning rate 0.2" in shown(view)


def test_a_clock_that_stands_still_divides_by_nothing(monkeypatch):
    monkeypatch.setattr(time, "monotonic", lambda: 5.0)
    assert View(Plan.create(Study("bandit", SETTINGS, 1, 100))).line() == "0 of 2 runs"
