"""What a benchmark's file may say, and what is said of one that can't be done."""

import pytest

from galton import UsageError
from galton.algorithms import ALGORITHMS
from galton_experiments.benchmark import stages
from galton_experiments.benchmark.draws import draws
from galton_experiments.benchmark.reading import of_record, read

from .files import FACTORIAL, RECORD, TEXT, changed, protocol

WRONG = [
    ({"budgets": {}}, "the file has 'budgets', which it can't have; it takes title, .*; did you mean budget"),
    ({"seed": -1}, "seed is -1; it must be an integer of at least 0"),
    ({"title": 3}, "title is 3; it must be words"),
    ({"imports": "module"}, "imports is 'module'; it must be a list"),
    ({"baseline": "gausian"}, "baseline is 'gausian'; choose from gaussian, bins, ppo; did you mean gaussian"),
    ({"budget__settings": 0}, "budget.settings is 0; it must be an integer of at least 1"),
    ({"budget__setings": 3}, "budget has 'setings', which it can't have; .* did you mean settings"),
    ({"methods__bins__label": "Gaussian"}, "methods has two with the label 'Gaussian'; give each a label of its own"),
    (
        {"fixed__decay_steps": {"value": True, "times": "steps"}, "prior__decay_steps": None},
        "fixed.decay_steps.value has True; it must have finite numbers",
    ),
    ({"budget__steps": 1e6}, "budget.steps is 1000000.0; it must be an integer"),
    ({"selection__metric": "loss"}, "selection.metric is 'loss'; choose from evaluation_return"),
    ({"selection__last": 0.0}, "selection.last is 0.0; it must be above 0, and 1 at most"),
    ({"prior__learning_rate": 0.1}, "prior.learning_rate is 0.1, which is no prior; fix it in a fixed table"),
    ({"fixed__eta": {"uniform": [1, 2]}}, "fixed.eta is a prior; move it to prior, or to the search of a method"),
    ({"fixed__learning_rate": 0.1}, "fixed has learning_rate, and so has prior; leave it in one of them"),
    ({"fixed__n_stepps": 3}, "fixed has 'n_stepps', which is no setting; did you mean n_steps"),
    ({"methods__bins": None, "methods__ppo": None}, "methods has fewer than two"),
    ({"methods": {}}, r"methods is missing; add a \[methods.NAME\] table for each"),
    ({"methods__bins": 3}, "methods.bins is 3; it must be a table"),
    ({"methods__a/b": {}}, "methods has 'a/b', which no file can be called"),
    ({"methods__bins__label": ""}, "methods.bins.label is ''; it must be words"),
    ({"methods__bins__loss": "x"}, "methods.bins has 'loss', which it can't have; it takes label, fixed, search"),
    ({"methods__bins__fixed__loss": "hlgauss"}, "methods.bins on tasks.bandit: loss is 'hlgauss'; choose from"),
    ({"methods__bins__fixed__n_bins": 1}, "methods.bins on tasks.bandit: n_bins is 1; it must be"),
    ({"methods__bins__fixed__clip_range": 0.1}, "methods.bins on tasks.bandit: clip_range is 0.1; it goes with"),
    ({"methods__bins__fixed__policy": "gaussian"}, "methods.bins on tasks.bandit: policy is 'gaussian', but the loss"),
    ({"methods__ppo__fixed__batch_size": 3}, "methods.ppo on tasks.bandit: batch_size is 3"),
    ({"methods__ppo__fixed__algorithm": "ppp"}, "algorithm is 'ppp'; choose from a2c, ppo, trpo, v-mpo"),
    ({"methods__ppo__fixed__algorithm": ["ppo"]}, "methods.ppo has algorithm .*; it must be a name"),
    ({"methods__bins__search__learning_rate": {"uniform": [1, 2]}}, "methods.bins.search has learning_rate, and so"),
    ({"methods__bins__search__n_bins": {"choice": [1, 2]}}, "methods.bins.search has n_bins, and so has prior, fixed"),
    (
        {"fixed__eta": 1.0},
        "methods.bins.search has eta, and so has prior, fixed or methods.bins.fixed; leave it in one",
    ),
    (
        {"methods__gaussian__search": {"eta": {"uniform": [1, 2]}}},
        "methods.gaussian.search has eta, which its loss and",
    ),
    ({"methods__bins__search__algorithm": {"choice": ["a2c", "ppo"]}}, "methods.bins.search has algorithm; make a"),
    ({"prior__algorithm": {"choice": ["a2c", "ppo"]}}, "prior has algorithm, whose defaults would not be drawn with"),
    ({"methods__bins__label": "$x$"}, "methods.bins.label is '\\$x\\$'; it must be words on one line, without"),
    ({"methods__bins__label": "_bins"}, "methods.bins.label is '_bins'; it must be words"),
    ({"methods__bins__label": "a\nb"}, "methods.bins.label is 'a.*b'; it must be words"),
    ({"methods__bins__fixed__loss": ["hl-gauss"]}, "methods.bins has loss .*; it must be a name"),
    ({"fixed__vf_coef": 10**400}, "methods.gaussian on tasks.bandit: "),
    (
        {"prior__vf_coef": {"uniform": [0, 10**400]}},
        "prior.vf_coef.uniform has 1000.*; it must have finite numbers, less",
    ),
    ({"budget__steps": 10**30}, "tasks.bandit has .* steps; a run may have 2,000,000,000 at most"),
    ({"budget__fresh_steps": 3_000_000_000}, "tasks.bandit has 3,000,000,000 steps; a run may have 2,000,000,000"),
    (
        {"prior__learning_rate": {"choice": ["a", "b"]}, "tasks__bandit__scale": {"learning_rate": 2.5}},
        "methods.gaussian on tasks.bandit: ",
    ),
    ({"tasks__again": {"env": "bandit", "held_out": True}}, "tasks.again is the same as tasks.bandit; change one"),
    ({"tasks__again": {"env": "galton/Bandit-v0"}}, "tasks.again is the same as tasks.bandit; change one"),
    ({"budget__settings": 50_000}, "budget.settings times the number of methods is 150,000; draw 100,000 settings at"),
    ({"tasks": {}}, r"tasks is missing; add a \[tasks.NAME\] table for each"),
    ({"tasks__bandit": None, "tasks__noisy": None}, r"tasks has none to tune on; add a \[tasks.NAME\] table without"),
    ({"tasks__bandit__env": "bandid"}, "tasks.bandit: environment is 'bandid'"),
    ({"tasks__bandit__env_kwargs": {"dd": 1}}, "tasks.bandit: bandit has no constant 'dd'"),
    ({"tasks__bandit__held_out": 1}, "tasks.bandit.held_out is 1; it must be true or false"),
    ({"tasks__bandit__scale": {"gamm": 2}}, "tasks.bandit.scale has 'gamm'.* did you mean gamma"),
    ({"tasks__bandit__scale": {"gamma": 0}}, "tasks.bandit.scale.gamma is 0; it must be a finite number above 0"),
    ({"tasks__bandit__scale": {"gamma": True}}, "tasks.bandit.scale.gamma is True; it must be a finite number"),
    ({"tasks__bandit__scale": {"eta": 2}}, "tasks.bandit.scale has eta, which prior does not draw; draw it there"),
    ({"tasks__bandit__scale": 2}, "tasks.bandit.scale is 2; it must be a table"),
    (
        {"tasks__bandit__scale": {"gamma": 2}},
        "methods.gaussian on tasks.bandit: gamma is .*between 0 and 1",
    ),
    ({"tasks__bandit__steps": 1.5}, "tasks.bandit.steps is 1.5; it must be an integer"),
    ({"tasks__bandit__fixed": {"loss": "gaussian"}}, "tasks.bandit.fixed has loss, which is the methods' or"),
    ({"tasks__bandit__fixed": {"gamma": 0.9}}, "tasks.bandit.fixed has gamma, which is the methods' or the prior's"),
    ({"tasks__bandit__fixed": {"eta": 1.0}}, "tasks.bandit.fixed has eta, and so has methods.bins; leave it in one"),
    (
        {"tasks__bandit__eval_episodes": 0},
        "tasks.bandit has eval_episodes 0, but selection.metric is 'evaluation_return'",
    ),
    (
        {"methods__gaussian__fixed__gamma": 0.9, "methods__bins__fixed__gamma": 0.9},
        "prior.gamma is drawn for no method, since each fixes it or has no use for it",
    ),
    (
        {"prior__clip_range": {"uniform": [0.1, 0.2]}, "methods__ppo__fixed__algorithm": "a2c"},
        "prior.clip_range is drawn for no method, since each fixes it or has no use for it",
    ),
]


def begin(places):
    known = protocol(**places)
    stages.check(known, draws(known))


WRONG += [
    ({"design": "nested"}, "design is 'nested'"),
    ({"anchors": 3}, r"anchors is 3; add a \[anchors.NAME\] table"),
    ({"anchors": {"usual": {"gama": 0.9}}}, "anchors.usual has 'gama', which is no setting"),
    ({"anchors": {str(i): {} for i in range(3)}}, "budget.settings is 3, and anchors are 3 of them"),
    (
        {"methods__bins__anchors": {"usual": {"eta": 1.0}}},
        "methods.bins.anchors has usual, which is no table of anchors",
    ),
    (
        {"anchors": {"usual": {}}, "methods__bins__anchors": {"usual": {"n_bins": 9}}},
        "methods.bins.anchors.usual has n_bins, and so has methods.bins.fixed",
    ),
    ({"anchors": {"usual": {"decay_steps": 1000}}}, 'anchors.usual.decay_steps is not counted .* with times = "steps"'),
    (
        {"anchors": {"usual": {"n_envs": 3}}},
        "tasks.noisy.fixed has n_envs, and so has anchors.usual",
    ),
    ({"anchors": {"usual": {"loss": "gaussian"}}}, "anchors.usual has loss, which is the methods'"),
    ({"methods__bins__time": 1.5}, 'methods.bins has time, which goes with design = "factorial"'),
    ({"methods__bins__time": -1}, "methods.bins.time is -1; it must be a finite number above 0"),
    ({"methods__bins__time": 10**400}, "methods.bins.time is 1000"),
    (FACTORIAL | {"methods__gaussian__time": 1.5}, "methods.gaussian has time, but is the baseline"),
    (FACTORIAL | {"tasks__four__held_out": True}, "tasks.four is held out, but a factorial design"),
    (FACTORIAL | {"budget__fresh_seeds": 3}, "budget has fresh_seeds, but a factorial design"),
    (FACTORIAL | {"tasks__noisy__fresh_steps": 3}, "tasks.noisy has fresh_steps, but a factorial design"),
    (FACTORIAL | {"tasks__budget": {"env": "bandit", "fresh_steps": 3}}, "tasks.budget has fresh_steps, but a fact"),
    (FACTORIAL | {"tasks__noisy": None, "tasks__four": None}, "tasks has one, but a factorial design"),
    (FACTORIAL | {"budget__seeds": 1}, "budget.seeds is 1, but a factorial design"),
]


@pytest.mark.parametrize(("places", "words"), WRONG, ids=[str(places) for places, _ in WRONG])
def test_a_wrong_file_is_refused_by_the_place_with_a_remedy(places, words):
    with pytest.raises(UsageError, match=words):
        begin(places)


def test_a_method_that_searches_nothing_is_refused():
    places = {"prior": {"gamma": {"uniform": [0.1, 0.9]}}, "methods__gaussian__fixed__gamma": 0.9}
    with pytest.raises(UsageError, match=r"methods.gaussian searches nothing, so its draws would all be alike"):
        protocol(**places)
    assert protocol(**places, budget__settings=1).budget.settings == 1


def test_a_factorial_file_has_one_stage():
    known = protocol(**FACTORIAL, methods__bins__time=2)
    assert (known.design, known.methods[1].time, known.held_out) == ("factorial", 2.0, ())
    assert protocol().design == "stages"


def test_the_file_is_named(tmp_path):
    file = tmp_path / "mine.toml"
    file.write_text(TEXT)
    assert read(file).title == "mine"
    assert read(file).digest == of_record(RECORD).digest
    file.write_text(TEXT.replace("seed = 3", "seed = -3"))
    with pytest.raises(UsageError, match=r"file is '.*mine.toml': seed is -3"):
        read(file)
    file.write_text(TEXT.replace('env = "bandit"', "env = 2026-11-23"))
    with pytest.raises(UsageError, match="it holds a date or a time"):
        read(file)
    for text in ("[budget", "\0", "x = " + "[" * 2000, "x = " + "1" * 5000):
        file.write_text(text)
        with pytest.raises(UsageError, match="which can't be read as TOML"):
            read(file)
    with pytest.raises(UsageError, match="which can't be read as TOML"):
        read(tmp_path / "none.toml")


def test_a_file_may_extend_another(tmp_path):
    (tmp_path / "base.toml").write_text(TEXT)
    file = tmp_path / "more.toml"
    file.write_text('extends = "base.toml"\nseed = 4\n[fixed]\nn_steps = 10\n')
    known = read(file)
    assert (known.seed, [*known.fixed], len(known.methods)) == (4, ["n_steps"], 3)
    assert known.digest == protocol(seed=4, fixed={"n_steps": 10}).digest != protocol().digest
    file.write_text('extends = "more.toml"\n')
    with pytest.raises(UsageError, match="extends leads back to itself"):
        read(file)
    for written, said in (("3", "3"), ('"a\\u0000b"', "'a.*b'")):
        file.write_text(f"extends = {written}\n")
        with pytest.raises(UsageError, match=f"extends is {said}; give the name of a file"):
            read(file)


def test_an_algorithm_of_a_module_that_the_file_names_is_known(monkeypatch):
    def importing(modules):
        assert modules == ("mine",)
        monkeypatch.setitem(ALGORITHMS, "mine", type("Mine", (ALGORITHMS["a2c"],), {"name": "mine"}))

    record = changed(imports=["mine"], methods__bins__fixed__algorithm="mine")
    with pytest.raises(UsageError, match="algorithm is 'mine'; choose from a2c, ppo"):
        of_record(record)
    assert of_record(record, importing=importing).algorithm(of_record(record).methods[1]) == "mine"


def test_steps_of_a_task_are_its_steps_on_fresh_seeds_too():
    known = protocol(budget__fresh_steps=1000, tasks__four__steps=50)
    steps = {task.name: (task.steps(False), task.steps(True)) for task in known.tasks}
    assert steps == {"bandit": (100, 1000), "noisy": (200, 300), "four": (50, 50)}


def test_the_hash_is_of_content_and_order_alone(tmp_path):
    file = tmp_path / "mine.toml"
    file.write_text("# a comment\n" + TEXT.replace("0.01", "1e-2"))
    assert read(file).digest == protocol().digest
    turned = changed()
    turned["methods"] = dict(reversed(turned["methods"].items()))
    assert of_record(turned).digest != protocol().digest


def test_a_program_of_another_draw_is_checked_on_the_later_tasks_too():
    bins = {"loss": "hl-one-hot", "policy": "joint"}
    known = protocol(
        budget__settings=8,
        methods__bins={"fixed": bins, "search": {"n_bins": {"choice": [5, 100]}}},
        tasks__four__env="Hopper-v5",
        tasks__four__env_kwargs={},
        methods__ppo=None,
        prior__clip_range=None,
    )
    drawn = draws(known)
    assert {draw["n_bins"] for draw in drawn["bins"]} == {5, 100}
    with pytest.raises(UsageError, match=r"methods\.bins on tasks\.four: n_bins is 100"):
        stages.check(known, drawn)


def test_tuning_tasks_of_other_lengths_may_share_fresh_runs():
    assert protocol(tasks__again={"env": "bandit", "steps": 150, "fresh_steps": 100}).tuning


def test_every_draw_that_may_be_selected_is_checked_on_the_later_tasks():
    known = protocol(budget__settings=8, tasks__four__scale={"gamma": 1.003}, methods__ppo=None, prior__clip_range=None)
    drawn = draws(known)
    assert stages.afterwards(known, drawn, stages._all(known, 0))
    with pytest.raises(UsageError, match=r"methods.* on tasks.four: gamma is 1\.0.*; it must be"):
        stages.check(known, drawn)
