"""All that a benchmark has found so far, and the same as a record for JSON."""

import dataclasses
import functools
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from galton_experiments.analysis.plain import plain, rounded
from galton_experiments.benchmark.draws import Draws
from galton_experiments.benchmark.factorial import Answers, answers
from galton_experiments.benchmark.protocol import Protocol
from galton_experiments.benchmark.runs import Runs
from galton_experiments.benchmark.selection import BestOf, Selected, best_of_draws, normalised, select
from galton_experiments.benchmark.stages import Stage
from galton_experiments.benchmark.standings import Standings, standings


@dataclasses.dataclass(frozen=True, eq=False)
class Found:
    """The results of a benchmark are those of the stages that are done. A stage with a task missing is not."""

    protocol: Protocol
    draws: Draws
    tuning: Sequence[Runs]
    """The runs of the first stage, one for each task."""
    later: Mapping[Stage, Sequence[Runs]] = dataclasses.field(default_factory=dict)
    """Those of the later stages that are done, by stage."""
    speeds: Mapping[str, Mapping[str, int | float]] = dataclasses.field(default_factory=dict)
    """Steps a second of the first stage, by task and method, as far as the folder knows them."""

    @property
    def runs(self) -> dict[Stage, Sequence[Runs]]:
        """The runs of all stages that are done, in order."""
        return {"tuning": self.tuning, **self.later}

    @functools.cached_property
    def scores(self) -> dict[str, dict[str, np.ndarray]]:
        """The normalised score of each run of the first stage, `[draws, trials]`, by task and method."""
        methods = [method.name for method in self.protocol.methods]
        return normalised({each.task: {m: each.finals(m, "draw") for m in methods} for each in self.tuning})

    @functools.cached_property
    def selected(self) -> Selected:
        """The draws that the first stage selected."""
        return select(self.scores)

    @functools.cached_property
    def best_of(self) -> dict[str, BestOf]:
        """Return what tuning with fewer draws gets, by method."""
        return {method.name: best_of_draws(self.scores, method.name) for method in self.protocol.methods}

    @functools.cached_property
    def standings(self) -> dict[Stage, Standings]:
        """Compare the methods in each of the later stages."""
        return {stage: standings(self.protocol, runs) for stage, runs in self.later.items()}

    @functools.cached_property
    def factorial(self) -> Answers:
        """Compare the methods by the runs of a factorial design."""
        return answers(self.protocol, self.tuning, self.scores, self.speeds)

    def record(self) -> dict[str, Any]:
        """All numbers, for JSON; what is not known is null."""
        methods = self.protocol.methods
        in_stages = self.protocol.design == "stages"
        given = {
            "benchmark": self.protocol.digest,
            "title": self.protocol.title,
            "file": self.protocol.record,
            "draws": self.draws,
        }
        results = {
            "selected": self.selected,
            **({"best_of": self.best_of} if in_stages else {"factorial": self.factorial}),
            "scores_of_draws": {
                task: {method: runs.mean(1) for method, runs in of_method.items()}
                for task, of_method in self.scores.items()
            },
            "diverged_draws": {m.name: sum(runs.diverged(m.name, "draw") for runs in self.tuning) for m in methods},
            "stages": self.standings,
        }
        return plain(given) | plain(results, rounded)
