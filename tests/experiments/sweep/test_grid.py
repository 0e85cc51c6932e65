"""Studies as data."""

import collections

import pytest

from galton import LOSSES
from galton.envs import ENVS
from galton.errors import UsageError
from galton_experiments.sweep.grid import GRIDS, expand, find_grid, paper_grid, random_grid, task_defaults
from galton_experiments.sweep.study import Setting, Study


@pytest.mark.parametrize(("env", "n"), [("bandit", 76), ("lqr", 88), ("acrobot", 88), ("HalfCheetah-v5", 88)])
def test_the_papers_grid_has_its_settings_in_seven_programs(env, n):
    settings = paper_grid(env, task_defaults(env))
    assert len(set(settings)) == len(settings) == n
    assert len({setting.program for setting in settings}) == 7
    per_loss = collections.Counter(setting["loss"] for setting in settings)
    assert per_loss == {"gaussian": 4, "hl-one-hot": 12, "hl-gauss": n - 16}


def test_the_papers_grid_is_that_of_the_appendix():
    settings = find_grid("paper", "mountain-car")
    assert {s["learning_rate"] for s in settings} == {1e-4, 3e-4, 7e-4, 1e-3}
    assert {s["eta"] for s in settings if s["loss"] == "hl-gauss"} == {0.01, 0.05, 0.1, 0.25, 0.5, 0.75}
    assert {s["n_bins"] for s in settings if s["loss"] != "gaussian"} == {50, 100, 200}
    bandit = find_grid("paper", "bandit")
    assert {s["learning_rate"] for s in bandit} == {0.01, 0.05, 0.1, 1}
    assert {(s["n_steps"], s["net_arch"]) for s in bandit} == {(5, ())}


def test_lists_are_axes_and_the_rest_is_fixed():
    blocks = [
        {"loss": "gaussian", "learning_rate": [1e-3, 1e-4], "net_arch": (8, 8)},
        {"loss": "hl-gauss", "eta": [1, 2, 4], "n_bins": [10, 20], "net_arch": [(8,), ()]},
    ]
    settings = expand(blocks, {"n_steps": 7, "gamma": 0.5})
    assert len(settings) == 2 + 12
    assert all(s["n_steps"] == 7 and s["gamma"] == 0.5 for s in settings)
    assert {s["net_arch"] for s in settings if s["loss"] == "gaussian"} == {(8, 8)}
    assert {s["net_arch"] for s in settings if s["loss"] == "hl-gauss"} == {(8,), ()}
    assert expand(blocks + blocks, {}) == expand(blocks, {})
    ordered = expand([{"loss": "hl-gauss", "ordered": [["gear"], []]}], {})
    assert [s["ordered"] for s in ordered] == [("gear",), ()]
    assert expand([{"loss": "hl-gauss", "ordered": ["gear"]}], {}) == ordered[:1]


def test_what_some_of_a_grid_have_a_use_for_is_left_out_for_the_others():
    losses = ["gaussian", "hl-one-hot", "hl-gauss"]
    base = {"bin_centers": "bounds", "target_tails": "edges", "initial_policy": "clipped-gaussian", "eta": 2.0}
    settings = expand([{"loss": losses}], base)
    assert settings == (
        Setting({"loss": "gaussian", "eta": 2.0}),  # a name of before
        Setting({"loss": "hl-one-hot", "bin_centers": "bounds", "initial_policy": "clipped-gaussian", "eta": 2.0}),
        Setting({"loss": "hl-gauss", **base}),
    )
    of_old = {"initial_policy": "gaussian"}
    assert [setting["initial_policy"] for setting in expand([{"loss": losses}], of_old)] == ["gaussian"] * 3
    owners = "loss 'hl-gauss', 'hl-gauss-centred' or policy 'smoothed'"
    with pytest.raises(UsageError, match=f"target_tails is 'edges'; it goes with {owners}"):
        expand([{"loss": losses[:2]}], base)
    with pytest.raises(UsageError, match="bin_centers is 'bounds'; it goes with policy 'histogram'"):
        expand([{"loss": losses, "bin_centers": "bounds"}], {})


def test_an_axis_that_a_loss_has_no_use_for_makes_no_more_settings_of_it():
    axes = {"n_bins": [50, 100, 200], "eta": [0.5, 1.0, 2.0, 4.0], "learning_rate": [0.1, 0.2]}
    settings = expand([{"loss": ["gaussian", "hl-one-hot", "hl-gauss"], **axes}], {})
    assert collections.Counter(setting["loss"] for setting in settings) == {
        "gaussian": 2,
        "hl-one-hot": 3 * 2,
        "hl-gauss": 3 * 4 * 2,
    }
    assert len(expand([{"loss": "gaussian", "eta": [1.0, 2.0]}], {})) == 2  # of names that nobody there uses


def test_a_random_grid_needs_a_rate_and_no_schedule():
    with pytest.raises(UsageError, match=r"^learning_rate is linear\(0.1, 0\), a schedule, around which no rate"):
        random_grid(task_defaults("bandit") | {"learning_rate": "linear(0.1, 0)"})


def test_a_setting_is_told_with_all_that_its_study_varies():
    settings = expand([{"loss": ["gaussian", "hl-gauss"], "gamma": [0.9, 0.99], "net_arch": [(), (8,)]}], {})
    study = Study("bandit", settings, 1, 100)
    assert {*study.varied} == {"loss", "gamma", "net_arch"}
    told = [setting.brief(study.varied) for setting in settings]
    assert told[0] == "learning rate 0.0007, net_arch (), gamma 0.9"
    assert len({*told}) == len(settings)
    mixed = expand([{"loss": "gaussian"}, {"loss": "hl-gauss", "target_tails": ["edges", "reflected"]}], {})
    first, *others = (setting.brief(Study("bandit", mixed, 1, 100).varied) for setting in mixed)
    assert "target_tails" not in first  # which a Gaussian has no use for
    assert [brief.rpartition(" ")[2] for brief in others] == ["edges", "reflected"]


def test_a_setting_survives_its_record_and_its_name_is_of_its_content():
    for setting in random_grid(task_defaults("lqr")):
        assert Setting(setting.record()) == setting
        assert Setting(setting.record()).name == setting.name
    names = {setting.name for setting in paper_grid("lqr", {})}
    assert len(names) == 88


def test_a_longer_random_draw_begins_with_a_shorter_one_and_covers_all_losses():
    short, long = (random_grid(task_defaults("lqr"), n) for n in (3, 9))
    assert len(short) == 3 * len(LOSSES)
    assert set(short) < set(long)
    assert random_grid(task_defaults("lqr"), 3, seed=1) != short
    for n, wanted in ((0, "an integer of at least 1"), (100_001, "at most 100,000")):
        with pytest.raises(UsageError, match=f"n_settings is {n}; it must be {wanted}"):
            random_grid(task_defaults("lqr"), n)
    for setting in long:
        assert 7e-5 <= setting["learning_rate"] <= 7e-3
        assert 0.1 <= setting["eta"] <= 4


def test_a_grid_is_read_from_toml(tmp_path):
    path = tmp_path / "grid.toml"
    path.write_text('[[grid]]\nloss = "gaussian"\n[[grid]]\nloss = "hl-gauss-centred"\neta = [2.0, 4]\nn_bins = [50]\n')
    assert find_grid(str(path), "lqr") == (
        Setting({"loss": "gaussian", "learning_rate": 7e-4}),
        Setting({"loss": "hl-gauss-centred", "n_bins": 50, "learning_rate": 7e-4, "eta": 2.0}),
        Setting({"loss": "hl-gauss-centred", "n_bins": 50, "learning_rate": 7e-4, "eta": 4.0}),
    )


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("grid = 3", "must hold one or more"),
        ("[[grid]]\n[other]", "must hold one or more"),
        ("", "must hold one or more"),
        ("[[grid]", "can't be read as TOML"),
        ('[[grid]]\nlose = "gaussian"', "'lose' is no setting; did you mean loss?"),
        ("[[grid]]\nwidth = 3", "'width' is no setting; choose from activation, algorithm"),
        ('[[grid]]\nloss = "mse"', "loss is 'mse'; choose from gaussian"),
        ("[[grid]]\neta = []", "eta is an empty list"),
        ('[[grid]]\nalgorithm = ["a2c", "ppo"]', "algorithm is ['ppo'], and the base's settings are of 'a2c'"),
        ("[[grid]]\neta = [0.5, -1]", "eta is -1.0; it must be finite, and greater than 0"),
        ('[[grid]]\neta = "wide"', "eta is 'wide'; it must be a number"),
        ("[[grid]]\nn_bins = [1]", "n_bins is 1; it must be an integer of at least 2"),
        (f"[[grid]]\neta = {'[' * 5000}", "can't be read as TOML"),
        (f"[[grid]]\neta = {'1' * 5000}", "can't be read as TOML"),
        (
            "[[grid]]\n" + "\n".join(f"{name} = {[*range(1, 51)]}" for name in ("n_steps", "n_envs", "eta", "n_bins")),
            "n_steps, n_envs, eta, n_bins have 6,250,000 combinations; give lists with 100,000 at most",
        ),
    ],
)
def test_a_wrong_grid_is_refused_in_words(tmp_path, text, message):
    path = tmp_path / "grid.toml"
    path.write_text(text)
    with pytest.raises(UsageError, match="grid") as told:
        find_grid(str(path), "lqr")
    assert message in str(told.value)


def test_an_unknown_grid_is_taken_for_a_file():
    with pytest.raises(UsageError, match="grid is 'papers'"):
        find_grid("papers", "lqr")


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"trials": 0}, "trials is 0"),
        ({"steps": 0}, "steps is 0"),
        ({"seed": -1}, "seed is -1"),
        ({"seed": 2**63}, "less than"),
        ({"settings": ()}, "settings is empty"),
        ({"settings": (Setting({}),) * 2}, "the same setting twice"),
    ],
)
def test_a_wrong_study_is_refused(change, message):
    study = {"env": "lqr", "settings": (Setting({}),), "trials": 2, "steps": 100}
    with pytest.raises(UsageError, match=message):
        Study(**study | change)


def test_every_named_grid_fits_every_task():
    for name in GRIDS:
        for env in ENVS:
            assert {s["loss"] for s in find_grid(name, env)} <= set(LOSSES)
