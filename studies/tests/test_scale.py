import dataclasses

import pytest

from galton.tasks import TASKS
from studies.paper.trained import Scale, Trained, above_rest, null_because, rest, scale_of

from . import made_up


def grid(task, final_of, **options):
    return made_up.judgeable(lambda _, setting: final_of(setting), (task,), **options).sweeps[task]


def test_rest_is_the_better_of_doing_nothing_and_acting_at_random():
    assert rest("lqr") == pytest.approx(TASKS["lqr"].at_rest, abs=0.01)  # random actions earn −105
    assert rest("bandit") == 0
    assert rest("acrobot") == -500


def test_the_best_is_the_optimum_or_else_the_best_settings_mean():
    assert scale_of("bandit", grid("bandit", lambda _: 5.0)) == Scale(0.0, 25.0)
    by_rate = grid("acrobot", lambda s: 50.0 if s["loss"] == "hl-gauss-centred" else 1.0)
    assert scale_of("acrobot", by_rate).best == pytest.approx(-450, abs=0.1)
    assert scale_of("acrobot", grid("acrobot", lambda _: -1.0)) is None


def test_a_task_is_null_where_fewer_than_one_run_in_a_hundred_gets_above_rest():
    def learned_by(n):
        left = iter([5.0] * n)
        return grid("lqr", lambda _: next(left, -5.0), budget="paper")

    some, few = learned_by(13), learned_by(12)
    assert above_rest("lqr", some) == (13, 1248)
    assert null_because("lqr", some) == ""
    assert null_because("lqr", few) == "null: 12 of 1,248 runs ever earn more than rest"
    assert [*Trained({"lqr": some}).scales] == ["lqr"]
    assert [*Trained({"lqr": few}).nulls] == ["lqr"]


def test_grids_without_all_of_the_papers_settings_do_not_judge_settings():
    data = made_up.judgeable(lambda *_: 1.0, ("lqr", "acrobot"))
    assert [*data.whole_grids] == ["lqr", "acrobot"]
    lqr = grid("lqr", lambda _: 1.0, budget="grid")
    assert [*Trained(data.sweeps | {"lqr": lqr}).whole_grids] == ["lqr"]
    ants = made_up.judgeable(lambda *_: 1.0, ("ant",), budget="grid").sweeps
    assert [*Trained(ants | {"lqr": lqr}).whole_grids] == ["lqr"]
    fewer = dataclasses.replace(lqr.study, settings=lqr.study.settings[1:])
    assert [*Trained({"ant": ants["ant"], "lqr": dataclasses.replace(lqr, study=fewer)}).whole_grids] == ["lqr", "ant"]
    assert Trained({}).whole_grids == {}
