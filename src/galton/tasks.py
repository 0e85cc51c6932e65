"""The paper's seven tasks with the settings of App. C.2: the one table that commands, grids and the studies read."""

from collections.abc import Mapping
from typing import NamedTuple

from galton.envs.registry import is_known, key_of


class Task(NamedTuple):
    """One of the paper's tasks, or any other environment with settings that suit it."""

    env: str
    """One of ENVS, or a Gymnasium id."""
    title: str
    """Its name in figures."""
    d: int = 0
    """Action dimensions; 0 where they are not known."""
    in_jax: bool = True
    """True if the environment is one of ours, in pure JAX."""
    total_timesteps: int = 500_000
    """The number of environment steps that the paper trains for."""
    learning_rate: float = 7e-4
    """The learning rate that is taken where it is not tuned."""
    learning_rates: tuple[float, ...] = (1e-4, 3e-4, 7e-4, 1e-3)
    """The learning rates of the paper's grid."""
    etas: tuple[float, ...] = (0.01, 0.05, 0.1, 0.25, 0.5, 0.75)
    """HL-Gauss's widths in the paper's grid."""
    config: Mapping[str, object] = {}
    """The other settings that differ from their usual values."""
    n_logs: int = 100
    """The number of points on a learning curve, each with an evaluation."""
    n_eval_episodes: int = 10
    """The number of episodes in each evaluation."""
    at_rest: float | None = None
    """The mean return of the action 0 from the first step to the last, where a figure shows it."""
    solved: float | None = None
    """The return from which Gymnasium takes it as solved, where no run may come near and a figure has to show that."""


def _outside(env: str, title: str, d: int = 0, total_timesteps: int = 500_000, at_rest: float | None = None) -> Task:
    """A task outside JAX: fewer evaluations, since they cost."""
    return Task(env, title, d, False, total_timesteps, n_logs=50, n_eval_episodes=2, at_rest=at_rest)


TASKS = {
    "bandit": Task(
        "bandit",
        "Bandit",
        d=2,
        total_timesteps=2_000,
        learning_rate=0.05,
        learning_rates=(0.01, 0.05, 0.1, 1.0),
        etas=(0.1, 0.25, 0.5, 0.75, 1.0),
        config={"n_steps": 5, "net_arch": ()},
        at_rest=0.0,
    ),
    "lqr": Task("lqr", "LQR", d=2, at_rest=-26.03),
    "mountain-car": Task("mountain-car", "Mountain Car", d=1, at_rest=0.0, solved=90.0),
    "acrobot": Task("acrobot", "Acrobot", d=1, at_rest=-500.0),
    "reacher": _outside("Reacher-v5", "Reacher", d=2, at_rest=-11.69),
    "half-cheetah": _outside("HalfCheetah-v5", "HalfCheetah", d=6, total_timesteps=1_000_000, at_rest=-0.23),
    "ant": _outside("Ant-v5", "Ant", d=8, total_timesteps=1_000_000, at_rest=994.2),
}
"""The tasks by name, in the order of the paper's figures."""


def settings_of(env: object) -> dict[str, object]:
    """The settings that suit an environment that is called by its name, or nothing where it isn't.

    Commands, models and grids all begin with them. A model or a run without a named loss has a preset beside them.
    """
    if not isinstance(env, str):
        return {"resets": "first"} if getattr(getattr(env, "record", env), "resets_slowly", False) else {}
    task = task_of(env)
    return {"learning_rate": task.learning_rate, **task.config}


def task_of(env: str) -> Task:
    """The task on that environment, by either of its names; for any other environment the paper's usual settings."""
    env = key_of(env)
    if env.partition(":")[0] in ("brax", "playground", "mjx"):  # their resets are slow
        return Task(env, env, config={"resets": "first"})
    other = Task(env, env) if is_known(env) else _outside(env, env)
    return next((task for task in TASKS.values() if task.env == env), other)
