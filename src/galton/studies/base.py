"""What a figure of the paper is, as data."""

from collections.abc import Callable
from typing import NamedTuple

from matplotlib.figure import Figure

from galton.envs.base import Environment
from galton.envs.find import find
from galton.studies.summary import Summary
from galton.studies.sweeps import TASKS, Done


class FigureStudy(NamedTuple):
    """One figure: what is trained for it, and how it is drawn."""

    title: str
    caption: str
    sweeps: tuple[str, ...]
    """Keys of SWEEPS."""
    draw: Callable[[Done], Figure]
    """From the sweeps that are done, which may lack some of these."""


def optimum(task: str, **constants: object) -> float | None:
    """The return of the best controller, where it is known."""
    if not TASKS[task].in_jax:
        return None
    env = find(TASKS[task].env, **constants)
    return env.optimal_return if isinstance(env, Environment) else None


def present(done: Done, tasks: tuple[str, ...] = tuple(TASKS)) -> dict[str, Summary]:
    """The tasks whose main sweep is done."""
    return {task: done[task] for task in tasks if task in done}


def heading(task: str) -> str:
    """For a panel, as in the paper: with the action's dimensionality."""
    return f"{TASKS[task].title} (d = {TASKS[task].d})"
