import gymnasium
import pytest

from galton.envs import ENVS
from galton.envs.find import find
from galton.tasks import TASKS, task_of


@pytest.mark.parametrize("name", TASKS)
def test_a_task_is_what_its_environment_says(name):
    task = TASKS[name]
    assert task.in_jax == (task.env in ENVS)
    space = find(task.env).action_low if task.in_jax else gymnasium.make(task.env).action_space.low
    assert space.shape == (task.d,)


def test_a_task_is_found_by_either_name_of_its_environment():
    for key, entry in ENVS.items():
        assert task_of(key) is task_of(entry.gymnasium_id) is TASKS[key]
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
