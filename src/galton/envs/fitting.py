"""What a model asks of the environment that it is given."""

import gymnasium

from galton.envs.base import Environment
from galton.envs.host.action_box import ActionBox
from galton.envs.host.base import HostTask
from galton.envs.host.observations import Observations
from galton.envs.host.space_json import to_json
from galton.errors import require


def spaces_of(task: Environment | HostTask) -> tuple[ActionBox, Observations]:
    """What an environment takes and what it shows; UsageError for spaces that Galton can't use."""
    if isinstance(task, Environment):
        name = type(task).__name__
        return (
            ActionBox(name, gymnasium.spaces.Box(task.action_low, task.action_high)),
            Observations(name, gymnasium.spaces.Box(task.observation_low, task.observation_high)),
        )
    return ActionBox(task.name, task.action_space), Observations(task.name, task.observation_space)


def check_same_spaces(task: Environment | HostTask, actions: ActionBox, observations: Observations) -> None:
    """Raise UsageError unless an environment has the spaces of the model's own."""
    others = spaces_of(task)
    for kind, own, other in (("actions", actions, others[0]), ("observations", observations, others[1])):
        same = to_json(own.space) == to_json(other.space)  # the order of a Dict's keys matters too
        require(same, f"env has {kind} {other.space}; the model's are {own.space}")


def check_copies(task: Environment | HostTask, n_envs: int) -> None:
    """Raise UsageError for another number of copies than was given ready-made."""
    there = given(task)
    require(
        there in (None, n_envs),
        f"n_envs is {n_envs}, but {'one environment was' if there == 1 else f'{there} were'} given; "
        "leave n_envs out, or give an id or a function that makes the environment",
    )


def given(task: Environment | HostTask) -> int | None:
    """How many environments were given ready-made; None where as many copies are made as one likes."""
    return None if isinstance(task, Environment) else task.given
