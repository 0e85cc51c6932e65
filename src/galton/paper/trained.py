"""What was trained and measured, read once for all figures, tables and claims."""

import dataclasses
import functools
from collections.abc import Mapping
from typing import NamedTuple, get_args

import pyarrow as pa

from galton.paper.summary import Summary
from galton.paper.sweeps import AGAIN, MAIN, Budget, Sweep
from galton.tasks import TASKS


class Judged(NamedTuple):
    """A task whose best settings were trained twice, so that none is judged by the runs that it was chosen by."""

    chosen: Summary
    """The main sweep: the task's whole grid."""
    again: Summary
    """Each loss's best setting of it on fresh seeds."""


@dataclasses.dataclass(frozen=True, eq=False)
class Trained:
    """All that a folder of `galton reproduce` holds and figures are drawn from."""

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
    def largest_grids(self) -> dict[str, Summary]:
        """The grids that were done at the largest budget of any: a smaller one says less of what settings do."""
        budgets = get_args(Budget)
        most = max((budgets.index(summary.provenance["budget"]) for summary in self.grids.values()), default=0)
        return {task: summary for task, summary in self.grids.items() if summary.provenance["budget"] == budgets[most]}
