"""What a figure of the paper is, as data."""

from collections.abc import Callable, Mapping
from typing import NamedTuple

import pyarrow as pa
from matplotlib.figure import Figure

from galton.envs.base import Environment
from galton.envs.find import find
from galton.studies.summary import Summary
from galton.tasks import TASKS


class Data(NamedTuple):
    """What was trained."""

    sweeps: Mapping[str, Summary]
    """By their keys in SWEEPS; those that are not done are not in it."""
    propositions: pa.Table | None = None
    """What `gradients.collect` measured."""


class FigureStudy(NamedTuple):
    """One figure: what is trained for it, and how it is drawn."""

    title: str
    caption: str
    sweeps: tuple[str, ...]
    """Keys of SWEEPS."""
    draw: Callable[[Data], Figure]
    """From data that may lack some of these sweeps, but not all."""
    needs_propositions: bool = False
    """It draws those, not sweeps."""


def optimum(task: str) -> float | None:
    """The return of the best controller, where it is known."""
    if not TASKS[task].in_jax:
        return None
    env = find(TASKS[task].env)
    return env.optimal_return if isinstance(env, Environment) else None


def present(data: Data, tasks: tuple[str, ...] = tuple(TASKS)) -> dict[str, Summary]:
    """The tasks whose main sweep is done."""
    return {task: data.sweeps[task] for task in tasks if task in data.sweeps}


def heading(task: str) -> str:
    """For a panel, as in the paper: with the action's dimensionality."""
    return f"{TASKS[task].title} (d = {TASKS[task].d})"
