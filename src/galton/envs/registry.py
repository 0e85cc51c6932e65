"""The tasks by name, with the settings of App. C.2. Importing this costs no JAX: records load when they are made."""

import dataclasses
import importlib
import json
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any, NamedTuple

import gymnasium

from galton.errors import UsageError

if TYPE_CHECKING:
    from galton.envs.base import Environment


class Task(NamedTuple):
    """An entry of ENVS."""

    record: str
    """module:Class of the environment's record."""
    gymnasium_id: str
    title: str
    max_episode_steps: int
    total_timesteps: int = 500_000
    """The paper's training length."""
    learning_rate: float = 7e-4
    config: Mapping[str, Any] = {}
    """What differs from Config's defaults."""
    n_logs: int = 100
    """Points of a learning curve, each with an evaluation."""
    n_eval_episodes: int = 10


ENVS = {
    "bandit": Task(
        "galton.envs.bandit:Bandit",
        "galton/Bandit-v0",
        "Bandit",
        max_episode_steps=1,
        total_timesteps=2_000,
        learning_rate=0.05,
        config={"n_steps": 5, "net_arch": ()},
    ),
    "lqr": Task("galton.envs.lqr:LQR", "galton/LQR-v0", "LQR", max_episode_steps=100),
    "mountain-car": Task(
        "galton.envs.mountain_car:MountainCar",
        "galton/MountainCarContinuous-v0",
        "Mountain Car",
        max_episode_steps=999,
    ),
    "acrobot": Task("galton.envs.acrobot:Acrobot", "galton/AcrobotContinuous-v0", "Acrobot", max_episode_steps=500),
}


def find_task(name: str) -> tuple[str, Task]:
    """The key in ENVS and the entry, by either of its names; UsageError lists the names if there is none."""
    for key, task in ENVS.items():
        if name in (key, task.gymnasium_id):
            return key, task
    raise UsageError(f"environment is {name!r}; choose from {', '.join(ENVS)}")


def settings(name: str) -> Task:
    """The entry of that name, or the settings for an environment that is not ours: fewer evaluations, which cost."""
    if is_known(name):
        return find_task(name)[1]
    steps = _PAPER_STEPS.get(name, 500_000)
    return Task("", name, name, max_episode_steps=0, total_timesteps=steps, n_logs=50, n_eval_episodes=2)


_PAPER_STEPS = {"HalfCheetah-v5": 1_000_000, "Ant-v5": 1_000_000}
"""The paper's training length, where it is not 500,000 (App. C.2)."""


def is_known(name: str) -> bool:
    """Whether `find_task` knows the name."""
    return any(name in (key, task.gymnasium_id) for key, task in ENVS.items())


def make(name: str, **constants: Any) -> "Environment":
    """The environment of that name, with other constants than its defaults where given.

    Raises:
        UsageError: an unknown name, an unknown constant or one out of range.
    """
    _, task = find_task(name)
    module, record = task.record.split(":")
    cls = getattr(importlib.import_module(module), record)
    known = [field.name for field in dataclasses.fields(cls)]
    for constant in constants:
        if constant not in known:
            raise UsageError(f"{name} has no constant {constant!r}; it has {', '.join(known) or 'none'}")
    try:
        env: Environment = cls(**constants)
    except (TypeError, ValueError) as error:
        if isinstance(error, UsageError):
            raise
        raise UsageError(f"{name} can't be made with {constants}: {error}") from None
    return env


def read_constants(text: str) -> dict[str, Any]:
    """An environment's keyword arguments from JSON; lists become tuples, as hashable records want them.

    Raises:
        UsageError: no JSON, or no object.
    """
    try:
        constants = json.loads(text)
    except json.JSONDecodeError as error:
        raise UsageError(f"env_kwargs is {text!r}, which is not JSON: {error}") from None
    if not isinstance(constants, dict):
        raise UsageError(f"env_kwargs is {text!r}; it must be a JSON object")
    return {name: _tuples(value) for name, value in constants.items()}


def _tuples(value: Any) -> Any:
    return tuple(map(_tuples, value)) if isinstance(value, list) else value


def register_with_gymnasium() -> None:
    """Make every task available to gymnasium.make."""
    for key, task in ENVS.items():
        gymnasium.register(
            task.gymnasium_id,
            entry_point="galton.envs.as_gymnasium:GymnasiumEnv",
            max_episode_steps=task.max_episode_steps,
            kwargs={"task": key},
        )
