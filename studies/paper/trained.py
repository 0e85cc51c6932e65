"""All runs and measurements are read once for figures, tables and claims; so is the way from rest to the best."""

import dataclasses
import functools
from collections.abc import Mapping
from typing import NamedTuple, TypeVar

import numpy as np
import pyarrow as pa
from jaxtyping import Float

from galton.envs import LQR, Environment, JaxTask, find, read_constants
from galton.tasks import TASKS
from galton_experiments.analysis import rest_of
from galton_experiments.runs import Summary
from galton_experiments.sweep import Setting, mean_returns, paper_grid, task_defaults
from studies.paper.sweeps import AGAIN, MAIN, Sweep

Number = TypeVar("Number", float, np.float64, Float[np.ndarray, "*any"])

_LEARNERS = 0.01
"""The share of a grid's runs that must get above rest at some time; with fewer the task is null."""


class Scale(NamedTuple):
    """The way that there is to learn: what is earned without learning, and the best that is known."""

    rest: float
    best: float

    def share(self, value: Number) -> Number:
        """Place a return on the way from rest (0) to the best (1)."""
        return (value - self.rest) / (self.best - self.rest)

    def at(self, share: float) -> float:
        """The return at that share of the way."""
        return self.rest + share * (self.best - self.rest)


@functools.cache
def _environment(task: str, constants: str) -> Environment | None:
    env = find(TASKS[task].env, **read_constants(constants)) if TASKS[task].in_jax else None
    return env.record if isinstance(env, JaxTask) else None


def optimum(task: str, constants: str = "{}") -> float | None:
    """The return of the best controller, where it is known; the environment's constants are those of a Study."""
    env = _environment(task, constants)
    return None if env is None else env.optimal_return


def rest(task: str, constants: str = "{}") -> float | None:
    """The better of doing nothing and of acting at random, whose returns need no learning; None if neither is known."""
    env = _environment(task, constants)
    return rest_of(env, env.rest_return if isinstance(env, LQR) else TASKS[task].at_rest)


def scale_of(task: str, grid: Summary) -> Scale | None:
    """From rest to the optimum, or to the highest mean final return of any setting of the grid where none is known.

    That is the return in training or the deterministic policy's, whichever is higher. None where rest is not known, or
    nothing on the grid is better.
    """
    constants = grid.study.env_kwargs
    low, best = rest(task, constants), optimum(task, constants)
    means = (mean_returns(grid.study, grid.table, kind) for kind in ("training_return", "evaluation_return"))
    high = max((mean for of_kind in means for mean in of_kind.values()), default=-np.inf) if best is None else best
    return Scale(low, high) if low is not None and low < high < np.inf else None


def above_rest(task: str, grid: Summary) -> tuple[int, int]:
    """Count the runs of a grid that ever log a training return above rest, and all of its runs."""
    low, curves = rest(task, grid.study.env_kwargs), grid.curves("training_return")
    return int((curves > (-np.inf if low is None else low)).any(1).sum()), len(curves)


def null_because(task: str, grid: Summary) -> str:
    """Say why a task has nothing to compare, that fewer than 1% of its runs learn anything; "" where it has."""
    learners, runs = above_rest(task, grid)
    nothing = learners < _LEARNERS * runs or scale_of(task, grid) is None
    return f"null: {learners:,} of {runs:,} runs ever earn more than rest" if nothing else ""


class Judged(NamedTuple):
    """A task whose best settings were trained twice, so that none is judged by the runs that it was chosen by."""

    chosen: Summary
    """The main sweep: the task's whole grid."""
    again: Summary
    """Each loss's best setting of it on fresh seeds."""


@dataclasses.dataclass(frozen=True, eq=False)
class Trained:
    """All that a folder of `reproduce` holds and figures are drawn from."""

    sweeps: Mapping[str, Summary]
    """The summaries of the sweeps that are done, by name."""
    tables: Mapping[str, pa.Table] = dataclasses.field(default_factory=dict)
    """The tables that figures measured besides sweeps, by the figure's name."""

    def of(self, sweep: Sweep) -> Summary | None:
        """The summary of a sweep, or None where it is not done."""
        return self.sweeps.get(sweep.name)

    @functools.cached_property
    def grids(self) -> dict[str, Summary]:
        """The main sweeps that are done, by task."""
        return {task: self.sweeps[MAIN[task].name] for task in TASKS if MAIN[task].name in self.sweeps}

    @functools.cached_property
    def judged(self) -> dict[str, Judged]:
        """The main sweep and its winners on fresh seeds, by task, where both are done."""
        return {task: Judged(chosen, again) for task, chosen in self.grids.items() if (again := self.of(AGAIN[task]))}

    @functools.cached_property
    def whole_grids(self) -> dict[str, Summary]:
        """The grids that hold all of App. C.2's, by which all settings are judged; where none does, all there are."""
        whole = {
            task: grid for task, grid in self.grids.items() if paper_settings(grid.study.env) <= {*grid.study.settings}
        }
        return whole or self.grids

    @functools.cached_property
    def nulls(self) -> dict[str, str]:
        """Say why there is nothing to compare, by task, for those on which hardly any run learns anything."""
        reasons = {task: null_because(task, grid) for task, grid in self.grids.items()}
        return {task: why for task, why in reasons.items() if why}

    def title(self, task: str) -> str:
        """Return the name of a task in tables."""
        return TASKS[task].title + (" (null)" if task in self.nulls else "")

    @functools.cached_property
    def scales(self) -> dict[str, Scale]:
        """The way from rest to the best, by task, where something is learned."""
        found = {task: scale_of(task, grid) for task, grid in self.grids.items() if task not in self.nulls}
        return {task: scale for task, scale in found.items() if scale is not None}


@functools.cache
def paper_settings(env: str) -> frozenset[Setting]:
    """The grid of App. C.2 for a task's environment."""
    return frozenset(paper_grid(env, task_defaults(env)))
