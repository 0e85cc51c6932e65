"""What was trained and measured, read once for all figures, tables and claims."""

import dataclasses
import functools
from collections.abc import Mapping
from typing import NamedTuple

import pyarrow as pa

from galton.tasks import TASKS
from galton_experiments.runs import Summary
from galton_experiments.sweep import Setting, paper_grid, task_defaults
from studies.paper.scale import Scale, null_because, scale_of
from studies.paper.sweeps import AGAIN, MAIN, Sweep


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
        """Why there is nothing to compare, by task, for those on which hardly any run learns anything."""
        reasons = {task: null_because(task, grid) for task, grid in self.grids.items()}
        return {task: why for task, why in reasons.items() if why}

    @functools.cached_property
    def scales(self) -> dict[str, Scale]:
        """The way from rest to the best, by task, where something is learned."""
        found = {task: scale_of(task, grid) for task, grid in self.grids.items() if task not in self.nulls}
        return {task: scale for task, scale in found.items() if scale is not None}


@functools.cache
def paper_settings(env: str) -> frozenset[Setting]:
    """The grid of App. C.2 for a task's environment."""
    return frozenset(paper_grid(env, task_defaults(env)))
