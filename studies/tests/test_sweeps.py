import collections
import dataclasses

import pytest

from galton.errors import UsageError
from galton.tasks import TASKS
from galton_experiments.runs import Summary
from galton_experiments.sweep.grid import paper_grid, task_defaults
from studies.paper.registry import FIGURES, all_sweeps
from studies.paper.sweeps import AGAIN, CENTRED_ETAS, MAIN, Sweep, needed
from studies.paper.why import CHANGES, WHY_TASKS, best_of_each, change_of

from . import made_up
from .made_up import SWEEPS


def losses(study):
    return collections.Counter(setting["loss"] for setting in study.settings)


@pytest.mark.parametrize("task", TASKS)
def test_at_paper_budget_a_task_is_app_c2_and_centred_hl_gauss(task):
    study = SWEEPS[task].study("paper", {})
    env = TASKS[task].env
    assert set(paper_grid(env, task_defaults(env))) < set(study.settings)
    ours = [setting for setting in study.settings if setting["loss"] == "hl-gauss-centred"]
    assert len(ours) == 4 * len(CENTRED_ETAS) == len(study.settings) - len(paper_grid(env, task_defaults(env)))
    assert study.trials == (50 if task == "bandit" else 20)
    assert study.steps == {"bandit": 2_000, "half-cheetah": 10**6, "ant": 10**6}.get(task, 500_000)


@pytest.mark.parametrize(("task", "settings", "trials"), [("reacher", 12, 5), ("half-cheetah", 12, 5), ("ant", 8, 3)])
def test_the_small_budget_of_mujoco(task, settings, trials):
    study = SWEEPS[task].study("small", {})
    assert len(study.settings) == settings
    assert study.trials == trials
    assert study.steps == SWEEPS[task].study("paper", {}).steps


@pytest.mark.parametrize("budget", ["smoke", "small", "paper"])
@pytest.mark.parametrize("task", TASKS)
def test_every_budget_has_every_loss(budget, task):
    assert set(losses(SWEEPS[task].study(budget, {}))) == {"gaussian", "hl-one-hot", "hl-gauss", "hl-gauss-centred"}


def test_winners_train_again_on_fresh_seeds_and_on_other_bandits():
    done = made_up.data(lambda _, setting: setting["learning_rate"], ("bandit",)).sweeps
    main = done["bandit"].study
    winners = {best.setting for best in done["bandit"].best.values()}
    again = SWEEPS["bandit-again"].study("smoke", done)
    assert again.seed != main.seed
    noisy = SWEEPS["bandit-noise-5"].study("smoke", done)
    assert noisy == dataclasses.replace(
        main,
        settings=noisy.settings,
        env_kwargs='{"noise_std": 5.0}',
        seed=again.seed,
        common_seeds=True,
        eval_mean=True,
    )
    assert set(again.settings) == winners
    assert {setting["loss"] for setting in noisy.settings} == {"gaussian", "hl-gauss"}  # at this budget
    assert set(noisy.settings) < winners
    assert set(SWEEPS["bandit-d-4"].study("paper", done).settings) == winners


def test_the_controls_change_the_softmax_policies_alone():
    main = SWEEPS["bandit"].study("paper", {})
    for name, field in (("init-gaussian", "initial_policy"), ("gaussian-exploration", "exploration")):
        study = SWEEPS[f"bandit-{name}"].study("paper", {})
        expected = [
            setting.replace(**{field: "gaussian"}) for setting in main.settings if setting["loss"] != "gaussian"
        ]
        assert list(study.settings) == expected
        done = made_up.data(lambda _, setting: setting["learning_rate"], (f"bandit-{name}",)).sweeps
        again = SWEEPS[f"bandit-{name}-again"].study("smoke", done)
        assert set(again.settings) == {best.setting for best in done[f"bandit-{name}"].best.values()}
        assert again.seed != study.seed


@pytest.mark.parametrize("task", WHY_TASKS)
def test_the_study_of_causes_has_every_change_for_every_loss(task):
    study = SWEEPS[f"why-{task}"].study("paper", {})
    found = collections.Counter((change_of(s, TASKS[task].env), s["loss"]) for s in study.settings)
    assert set(found) == {(change, loss) for change in CHANGES for loss in losses(study)}
    assert all(count == (6 if loss == "hl-gauss-centred" else 3) for (_, loss), count in found.items())


@pytest.mark.parametrize("task", WHY_TASKS)
def test_the_best_of_each_change_and_loss_is_trained_again(task):
    def final(_, setting):
        return -abs(setting["learning_rate"] - 1e-3) - setting["eta"]

    name = f"why-{task}"
    done = made_up.data(final, (name,), budget="paper", noise=1e-6).sweeps
    again = SWEEPS[f"{name}-again"].study("paper", done)
    found = collections.Counter((change_of(s, TASKS[task].env), s["loss"]) for s in again.settings)
    assert found == dict.fromkeys(((change, loss) for change in CHANGES for loss in losses(again)), 1)
    assert {s["learning_rate"] for s in again.settings} == {1e-3}
    assert {s["eta"] for s in again.settings if s["loss"] == "hl-gauss-centred"} == {2.0}
    assert again.seed != done[name].study.seed


def test_a_setting_with_a_diverged_run_is_the_best_of_none():
    study = SWEEPS["why-lqr"].study("paper", {})
    highest = study.settings[0]
    table = made_up.results(study, lambda setting: float(setting == highest), diverged=[1])
    summary = Summary.of_results(study, table, made_up.PROVENANCE)
    assert highest not in best_of_each(summary)
    assert len(best_of_each(summary)) == len(CHANGES) * len(losses(study))


def test_winners_come_after_the_sweep_that_they_win():
    names = [sweep.name for sweep in needed([SWEEPS["bandit-noise-5"], AGAIN["lqr"], MAIN["bandit"]])]
    assert names == ["bandit", "bandit-noise-5", "lqr", "lqr-again"]


def test_two_sweeps_of_one_name_are_refused(monkeypatch):
    other = Sweep("lqr", MAIN["bandit"].study)
    mine = dataclasses.replace(FIGURES["figure-8"], sweeps=(other,))
    monkeypatch.setitem(FIGURES, "mine", mine)
    with pytest.raises(UsageError, match="sweep 'lqr' of mine is another"):
        all_sweeps()
    monkeypatch.setitem(FIGURES, "mine", dataclasses.replace(mine, sweeps=()))
    monkeypatch.setitem(FIGURES, "lqr", dataclasses.replace(mine, sweeps=(), measure=lambda budget: None))
    with pytest.raises(UsageError, match="'lqr' is a sweep, and a figure that measures something"):
        all_sweeps()
