"""Each stage of a benchmark trains the settings of every method on a task, as studies of a sweep."""

import dataclasses
import itertools
import json
from typing import Literal, NamedTuple

from galton.envs.find import find
from galton.envs.registry import is_known, read_constants
from galton.errors import UsageError
from galton.parts import Box
from galton.training.log import MEAN_ACTION_RETURN
from galton.training.train import log_points
from galton_experiments.benchmark.draws import Draws, setting
from galton_experiments.benchmark.protocol import Protocol, Task
from galton_experiments.benchmark.selection import Selected
from galton_experiments.sweep.study import Program, Setting, Study

Stage = Literal["tuning", "fresh", "held-out"]
Role = Literal["draw", "shared", "per-task"]
"""The role of a setting: a draw that may be selected, what was selected for all tasks, or for this one."""


class Entry(NamedTuple):
    """A setting of a method that is trained on a task."""

    method: str
    role: Role
    draw: int
    """The place of the draw among the method's, from 0."""
    setting: Setting


@dataclasses.dataclass(frozen=True)
class Part:
    """A task in a stage: what is trained there together."""

    stage: Stage
    task: Task
    trials: int
    """Runs of each setting."""
    entries: tuple[Entry, ...]
    """By method, role and draw; two of them may be one setting, which is trained once."""
    studies: tuple[Study, ...]
    """All settings, each once: a study for each number of log points that their updates make of the steps."""

    @property
    def name(self) -> str:
        """The name of its file, without the suffix, and of its folder."""
        return f"{self.stage}-{self.task.name}"


def tuning(protocol: Protocol, drawn: Draws) -> list[Part]:
    """The first stage: every draw of every method on every tuning task."""
    parts = []
    for task in protocol.tuning:
        entries = [
            Entry(method.name, "draw", i, setting(protocol, method, fields, task, fresh=False))
            for method in protocol.methods
            for i, fields in enumerate(drawn[method.name])
        ]
        parts.append(_part(protocol, "tuning", task, entries))
    return parts


def afterwards(protocol: Protocol, drawn: Draws, selected: Selected) -> list[Part]:
    """The second and the third stage: what was selected, on fresh seeds of the tuning tasks and on those held out.

    A factorial design has neither.
    """
    if protocol.design == "factorial":
        return []
    parts = []
    for task in (*protocol.tuning, *protocol.held_out):
        entries = []
        for method in protocol.methods:
            roles: dict[Role, int] = {"shared": selected.shared[method.name]}
            if not task.held_out:
                roles["per-task"] = selected.per_task[task.name][method.name]
            for role, i in roles.items():
                of_draw = setting(protocol, method, drawn[method.name][i], task, fresh=True)
                entries.append(Entry(method.name, role, i, of_draw))
        parts.append(_part(protocol, "held-out" if task.held_out else "fresh", task, entries))
    return parts


def _part(protocol: Protocol, stage: Stage, task: Task, entries: list[Entry]) -> Part:
    fresh = stage != "tuning"
    trials = protocol.budget.fresh_seeds if fresh else protocol.budget.seeds
    by_points: dict[int, dict[Setting, None]] = {}
    for entry in entries:
        points = len(log_points(entry.setting.rollout_size, task.steps(fresh), task.budget.logs))
        by_points.setdefault(points, {})[entry.setting] = None
    studies = [
        Study(
            task.env,
            tuple(settings),
            trials,
            task.steps(fresh),
            task.budget.logs,
            task.budget.eval_episodes,
            json.dumps(task.env_kwargs, sort_keys=True),
            2 * protocol.seed + fresh,
            protocol.imports,
            common_seeds=True,
            eval_mean=protocol.selection.metric == MEAN_ACTION_RETURN,
        )
        for settings in by_points.values()
    ]
    return Part(stage, task, trials, tuple(entries), tuple(studies))


def check(protocol: Protocol, drawn: Draws) -> None:
    """Raise UsageError, before anything is trained, for a task that can't be made or a draw that can't be trained."""
    boxes: dict[str, Box] = {}
    known = set[tuple[str, Program]]()
    later = (part for i in range(protocol.budget.settings) for part in afterwards(protocol, drawn, _all(protocol, i)))
    for part in itertools.chain(tuning(protocol, drawn), later):
        name = part.task.name
        try:
            if name not in boxes:
                boxes[name] = find(part.task.env, **read_constants(part.studies[0].env_kwargs)).actions.box
        except UsageError as error:
            raise UsageError(f"tasks.{name}: {error}") from None
        for entry in part.entries:
            if (name, entry.setting.program) not in known:
                known.add((name, entry.setting.program))
                try:
                    entry.setting.agent.on(boxes[name])
                except UsageError as error:
                    raise UsageError(f"methods.{entry.method} on tasks.{name}: {error}") from None


def _all(protocol: Protocol, i: int) -> Selected:
    """The draw i is selected of every method, for all tasks together and for each."""
    each = {method.name: i for method in protocol.methods}
    return Selected(each, {task.name: each for task in protocol.tuning})


def width(study: Study) -> int:
    """Return the most runs that a shard of a study has: shards are as few as they can be, and then as even.

    It depends on the study alone, so that the same file gives the same programs, and to the last bit the same numbers.
    """
    runs: dict[object, int] = {}
    for each in study.settings:
        runs[each.program] = runs.get(each.program, 0) + study.trials
    most = min(16 if is_known(study.env) else 32, max(runs.values()))
    shards = {n: sum(-(-count // n) for count in runs.values()) for n in range(most, most // 2, -1)}
    return min(shards, key=lambda n: (shards[n], n))
