"""Every method draws as often, and the common numbers alike."""

import numpy as np
import pytest

from galton import UsageError
from galton_experiments.benchmark import stages
from galton_experiments.benchmark.draws import draws, setting

from .files import changed, of_record, protocol

N = 16
KNOWN = protocol(budget__settings=N)
DRAWN = draws(KNOWN)


def column(drawn, name):
    return [each[name] for each in drawn]


def test_every_method_gets_all_draws_with_what_it_can_use():
    assert {method: len(of) for method, of in DRAWN.items()} == dict.fromkeys(("gaussian", "bins", "ppo"), N)
    assert [*DRAWN["gaussian"][0]] == ["decay_steps", "gamma", "learning_rate"]  # clip_range is PPO's alone
    assert [*DRAWN["bins"][0]] == ["decay_steps", "eta", "gamma", "learning_rate"]
    assert [*DRAWN["ppo"][0]] == ["clip_range", "decay_steps", "eta", "learning_rate", "log_std_init"]  # it fixes gamma


@pytest.mark.parametrize("method", ["bins", "ppo"])
def test_common_numbers_are_the_same_in_all_methods(method):
    for name in ("learning_rate", "decay_steps"):
        assert column(DRAWN["gaussian"], name) == column(DRAWN[method], name)


@pytest.mark.parametrize(("method", "name"), [("gaussian", "learning_rate"), ("gaussian", "gamma"), ("bins", "eta")])
def test_each_sixteenth_of_a_prior_is_drawn_once(method, name):
    prior = {**KNOWN.prior, **KNOWN.methods[1].search}[name]
    edges = np.array([prior.at(i / N) for i in range(N + 1)])
    counts = np.histogram(column(DRAWN[method], name), edges)[0]
    assert counts.tolist() == [1] * N


def test_a_choice_is_drawn_evenly():
    assert sorted(column(DRAWN["gaussian"], "decay_steps")) == [0] * 8 + [0.5] * 8


@pytest.mark.parametrize("seed", range(5))
def test_no_field_rises_or_falls_with_another(seed):
    names = ("learning_rate", "gamma", "vf_coef", "ent_coef", "max_grad_norm")
    prior = {name: {"uniform": [0.1, 1]} for name in names}
    search = {name: {"uniform": [1, 2]} for name in ("eta", "temperature")}
    known = protocol(budget__settings=N, seed=seed, prior=prior, methods__bins__search=search, methods__ppo=None)
    drawn = np.array([[*of.values()] for of in draws(known)["bins"]])
    found = np.corrcoef(drawn.T) - np.eye(7)
    assert np.abs(found).max() < 0.45  # of hypercubes by chance more in five of six
    for few in (1, 2):
        assert len(draws(protocol(budget__settings=few))["bins"]) == few


def test_fields_of_its_own_are_drawn_where_none_is_common():
    own = {"vf_coef": {"uniform": [1, 2]}}
    drawn = draws(protocol(budget__settings=N, prior={}, **{f"methods__{of}__search": own for of in DRAWN}))
    assert {method: len({*column(of, "vf_coef")}) for method, of in drawn.items()} == dict.fromkeys(DRAWN, N)


def test_neither_order_nor_other_methods_change_a_draw():
    record = changed(budget__settings=N)
    for table in ("methods", "prior"):
        record[table] = dict(reversed(record[table].items()))
    del record["methods"]["gaussian"]
    record["baseline"] = "bins"
    turned = draws(of_record(record))
    assert turned == {method: of for method, of in DRAWN.items() if method != "gaussian"}


def test_another_seed_draws_others_and_the_same_one_the_same():
    assert draws(protocol(budget__settings=N)) == DRAWN
    other = draws(protocol(budget__settings=N, seed=4))
    assert not {*column(other["gaussian"], "learning_rate")} & {*column(DRAWN["gaussian"], "learning_rate")}


def test_a_setting_is_made_of_the_draw_the_fixed_tables_and_the_usual_values():
    known = protocol()
    drawn = draws(known)
    noisy = known.tasks[1]
    assert noisy.name == "noisy"
    for fresh, steps in ((False, 200), (True, 300)):
        of = setting(known, known.methods[2], drawn["ppo"][0], noisy, fresh)
        assert [of[name] for name in ("n_envs", "n_steps", "net_arch", "batch_size")] == [2, 5, (), 10]
        assert of["normalize_advantage"]  # PPO's own default
        assert (of["gamma"], of["gae_lambda"]) == (0.5, 0.95)
        assert of["learning_rate"] == drawn["ppo"][0]["learning_rate"]
        assert of["decay_steps"] == drawn["ppo"][0]["decay_steps"] * steps
    of = setting(known, known.methods[0], drawn["gaussian"][0], noisy, False)
    assert (of["gae_lambda"], of["gamma"]) == (1.0, drawn["gaussian"][0]["gamma"])


def test_a_task_may_count_a_drawn_number_in_multiples():
    known = protocol(tasks__noisy__scale={"learning_rate": 10, "gamma": 0.5})
    drawn = draws(known)
    assert drawn == draws(protocol())
    for task, rate, discount in zip(known.tasks, (1, 10, 1), (1, 0.5, 1), strict=True):
        for method in known.methods:
            for each in drawn[method.name]:
                of = setting(known, method, each, task, False)
                assert of["learning_rate"] == rate * each["learning_rate"]
                assert of["gamma"] == (0.5 if method.name == "ppo" else discount * each["gamma"])  # which it fixes
                assert of["eta"] == each.get("eta", 0.25)


def test_seeds_are_common_to_methods_and_fresh_ones_are_others():
    parts = stages.tuning(KNOWN, DRAWN)
    first = {method.name: 0 for method in KNOWN.methods}
    parts += stages.afterwards(KNOWN, DRAWN, stages.Selected(first, {task.name: first for task in KNOWN.tuning}))
    assert [(part.name, part.trials) for part in parts] == [
        *(("tuning-bandit", 2), ("tuning-noisy", 2)),
        *(("fresh-bandit", 3), ("fresh-noisy", 3), ("held-out-four", 3)),
    ]
    assert {study.common_seeds for part in parts for study in part.studies} == {True}
    seeds = {part.stage: {study.seed for study in part.studies} for part in parts}
    assert seeds == {"tuning": {6}, "fresh": {7}, "held-out": {7}}
    assert [len(part.entries) for part in parts] == [3 * N, 3 * N, 6, 6, 3]
    assert [len(part.studies[0].settings) for part in parts] == [3 * N, 3 * N, 3, 3, 3]  # the same setting once


def test_settings_with_other_log_points_have_a_study_of_their_own():
    known = protocol(methods__ppo__fixed__n_steps=100, fixed={"net_arch": []}, tasks__noisy=None)
    (part,) = stages.tuning(known, draws(known))
    assert [len(study.settings) for study in part.studies] == [6, 3]


@pytest.mark.few
@pytest.mark.parametrize(
    ("settings", "trials", "width"), [(16, 3, 16), (2, 10, 10), (1, 10, 10), (3, 7, 11), (1, 17, 9)]
)
def test_shards_are_few_and_even(settings, trials, width):
    known = protocol(budget__settings=settings, budget__seeds=trials, methods__ppo=None, prior__clip_range=None)
    study = stages.tuning(known, draws(known))[0].studies[0]
    assert stages.width(study) == width


def test_a_common_field_that_a_method_has_no_use_for_is_not_drawn_for_it():
    known = protocol(prior__eta={"uniform": [0.5, 1]}, methods__bins__search=None, methods__ppo__search=None)
    drawn = draws(known)
    assert "eta" in drawn["bins"][0]
    assert "eta" in drawn["ppo"][0]
    assert "eta" not in drawn["gaussian"][0]
    alone = {"loss": "gaussian", "learning_rate": 0.1, "gamma": 0.9, "decay_steps": 0}
    with pytest.raises(UsageError, match=r"methods.gaussian searches nothing, so its draws would all be alike"):
        protocol(
            prior__eta={"uniform": [0.5, 1]},
            methods__gaussian__fixed=alone,
            methods__bins__search=None,
            methods__ppo__search=None,
        )


def test_anchors_are_the_first_draws_of_every_method():
    """With what a method has a use for and does not fix, and with its own; the random draws are as without them."""
    anchors = {"usual": {"learning_rate": 0.1, "gamma": 0.99, "clip_range": 0.2, "vf_coef": 0.7}, "none": {}}
    known = protocol(budget__settings=N + 2, anchors=anchors, methods__bins__anchors={"usual": {"eta": 2.0}})
    drawn = draws(known)
    assert drawn["gaussian"][0] == {"learning_rate": 0.1, "gamma": 0.99, "vf_coef": 0.7}
    assert drawn["bins"][0] == {"learning_rate": 0.1, "gamma": 0.99, "vf_coef": 0.7, "eta": 2.0}
    assert drawn["ppo"][0] == {"learning_rate": 0.1, "clip_range": 0.2, "vf_coef": 0.7}
    assert [of[1] for of in drawn.values()] == [{}, {}, {}]
    assert {method: of[2:] for method, of in drawn.items()} == DRAWN
    of = setting(known, known.methods[1], drawn["bins"][0], known.tasks[0], False)
    assert (of["eta"], of["vf_coef"], of["gamma"], of["decay_steps"]) == (2.0, 0.7, 0.99, 0)


def test_an_anchor_counts_in_lengths_of_a_run_as_the_prior_does():
    anchors = {"decays": {"decay_steps": {"value": 1, "times": "steps"}}}
    known = protocol(anchors=anchors)
    for task in known.tasks[:2]:
        of = setting(known, known.methods[0], draws(known)["gaussian"][0], task, False)
        assert of["decay_steps"] == task.steps(False)
