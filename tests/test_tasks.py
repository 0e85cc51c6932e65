import gymnasium
import pytest

from galton import A2C, ALGORITHMS, PPO
from galton.agents import read, words_of
from galton.cli._options import Training
from galton.envs import ENVS, Bandit
from galton.envs.find import find
from galton.models import Model
from galton.tasks import TASKS, task_of
from galton_experiments.sweep.grid import task_defaults
from galton_experiments.sweep.study import Setting


@pytest.fixture(autouse=True)
def settings_alone(monkeypatch):
    """A model here has settings and nothing to train, so that no program is compiled."""
    monkeypatch.setattr("galton.models.model.Run", lambda *settings: None)


@pytest.mark.parametrize("name", TASKS)
def test_a_task_is_what_its_environment_says(name):
    task = TASKS[name]
    assert task.in_jax == (task.env in ENVS)
    space = find(task.env).actions.low if task.in_jax else gymnasium.make(task.env).action_space.low
    assert space.shape == (task.d,)


def test_a_task_is_found_by_either_name_of_its_environment():
    for key in ("bandit", "lqr", "mountain-car", "acrobot"):
        assert task_of(key) is task_of(ENVS[key].gymnasium_id) is TASKS[key]
    assert task_of("switching-lqr").in_jax
    assert task_of("Ant-v5") is TASKS["ant"]


def test_any_other_environment_has_the_papers_usual_settings_and_few_evaluations():
    other = task_of("Hopper-v5")
    assert (other.title, other.in_jax, other.total_timesteps, other.learning_rate) == (
        "Hopper-v5",
        False,
        500_000,
        7e-4,
    )
    assert (other.n_logs, other.n_eval_episodes, other.config) == (50, 2, {})


NAMES = ["bandit", "galton/Bandit-v0", "lqr", "galton/LQR-v0", "mountain-car", "acrobot", "Pendulum-v1"]


@pytest.mark.parametrize("name", NAMES)
@pytest.mark.parametrize("algorithm", ALGORITHMS)
def test_one_name_is_one_experiment_for_models_and_for_commands(name, algorithm):
    command, model = Training.of_task(name, algorithm), Model(name, preset="paper", algorithm=algorithm)
    assert words_of(read(command.words)) == model.settings


@pytest.mark.parametrize("name", NAMES)
def test_a_grid_begins_with_the_same_settings(name):
    setting, model = Setting(task_defaults(name)), Model(name, preset="paper")
    assert words_of(setting.agent) == model.settings


def some(model):
    """What the tasks' settings differ in."""
    return tuple(model.settings[name] for name in ("learning_rate", "n_steps", "net_arch"))


@pytest.mark.parametrize("name", ["bandit", "galton/Bandit-v0"])
def test_the_bandit_by_its_name_has_the_papers_settings_and_what_is_told_goes_before_them(name):
    assert some(A2C(name)) == (0.05, 5, ())
    assert some(A2C(name, learning_rate=0.1, net_arch=(8,))) == (0.1, 5, (8,))


def test_an_algorithms_own_defaults_go_before_the_tasks():
    assert some(PPO("bandit", preset="paper")) == (3e-4, 2048, ())


def test_an_environment_that_is_there_has_no_name_and_the_usual_settings():
    model = A2C(Bandit(), preset="paper")
    assert some(model) == (7e-4, 20, (64, 64))
    assert model.settings == words_of(read({}))
