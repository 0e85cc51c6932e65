"""The protocol of a benchmark: what its TOML file says, checked before anything is trained."""

import dataclasses
import functools
import hashlib
import itertools
import json
from collections.abc import Collection, Mapping
from typing import Annotated, Any, Literal

from galton.envs.registry import key_of
from galton.errors import UsageError, require
from galton.fields import Within
from galton.losses import LOSSES
from galton.policies import POLICIES
from galton.types import Count
from galton.words import CHOICES, idle
from galton_experiments.benchmark.priors import Prior, Priors, Record
from galton_experiments.sweep.grid import MOST_SETTINGS
from galton_experiments.sweep.study import MOST_STEPS, Natural


@dataclasses.dataclass(frozen=True)
class Budget:
    """Every method gets the same budget."""

    settings: Count = 16
    """Draws of each method."""
    seeds: Count = 3
    """Runs of each draw on each tuning task; trial t has the same seed for all draws and methods."""
    fresh_seeds: Count = 10
    """Runs of what was selected, on seeds that had no part in selecting it."""
    steps: Count = 500_000
    """Environment steps of each run while settings are selected."""
    fresh_steps: Natural = 0
    """Environment steps of each run on fresh seeds; 0 is as many as `steps`."""
    logs: Count = 50
    """Points of each learning curve, with an evaluation at each."""
    eval_episodes: Natural = 10
    """Episodes of the deterministic policy at each of them."""


@dataclasses.dataclass(frozen=True)
class Selection:
    """Runs are judged by a metric, and settings are selected by a score."""

    score: Literal["mean-percentile"] = "mean-percentile"
    """A draw's score: the mean over tasks and seeds of its runs' percentiles among all runs of a task."""
    metric: Literal["evaluation_return", "mean_action_return", "training_return"] = "evaluation_return"
    """The curve of the log: evaluation_return is the deterministic policy's by the action that its configuration says,
    mean_action_return that by the mean action, training_return that of the policy that explores."""
    last: Annotated[float, Within(lambda x: (x > 0) & (x <= 1), "above 0, and 1 at most")] = 0.1
    """The share of the log points, from the last one back, whose mean a run is judged by."""


@dataclasses.dataclass(frozen=True)
class Method:
    """One of those that are compared."""

    name: str
    label: str
    """Its name in figures and tables."""
    fixed: Priors
    """Fields with the same value in all of its draws."""
    search: Priors
    """Fields that it alone draws, beside those that all methods draw."""
    anchors: Mapping[str, Priors]
    """The method's own fields in an anchor, by the anchor's name."""
    time: float | None
    """The time of one of its steps as a multiple of the baseline's; None takes the time of its runs."""


@dataclasses.dataclass(frozen=True)
class Task:
    """An environment to select settings on, or one that is held out."""

    name: str
    label: str
    env: str
    """A name in ENVS or a Gymnasium id (`module:Id` imports the module first)."""
    env_kwargs: Record
    held_out: bool
    """True if no setting is selected by it."""
    fixed: Priors
    """Fields with the same value for every method, such as n_envs."""
    scale: Mapping[str, float]
    """The factors of drawn numbers, by field, for every method: a task with a hundredth of the updates may need
    learning rates that are a hundred times those of the others."""
    budget: Budget
    """The file's, with what the task has of its own: steps, fresh_steps, logs and eval_episodes."""

    def steps(self, fresh: bool) -> int:
        """Environment steps of each run, while settings are selected or afterwards."""
        return (fresh and self.budget.fresh_steps) or self.budget.steps


@dataclasses.dataclass(frozen=True, eq=False)
class Protocol:
    """All that a benchmark's file says."""

    record: Record
    """The file as it was read."""
    title: str
    seed: int
    """Of the draws and of all runs: fresh seeds are drawn from it too, and are others."""
    design: Literal["stages", "factorial"]
    """The design: "stages" retrains what is selected; "factorial" judges it by the same runs' other seeds and tasks."""
    baseline: Method
    """The method that all others are compared with."""
    imports: tuple[str, ...]
    """Modules that every worker imports first."""
    budget: Budget
    selection: Selection
    fixed: Priors
    """Fields with the same value for all methods, unless a method or a task says otherwise."""
    prior: Priors
    """The fields that all methods draw, and draw alike."""
    anchors: Mapping[str, Priors]
    """Settings that all methods have as their first draws, by name."""
    methods: tuple[Method, ...]
    tasks: tuple[Task, ...]

    @property
    def tuning(self) -> tuple[Task, ...]:
        """The tasks that settings are selected on."""
        return tuple(task for task in self.tasks if not task.held_out)

    @property
    def held_out(self) -> tuple[Task, ...]:
        """The tasks that have no part in selecting."""
        return tuple(task for task in self.tasks if task.held_out)

    @functools.cached_property
    def digest(self) -> str:
        """A hash of the file's content, comments and layout aside; it stands in every file of results."""
        return hashlib.sha256(json.dumps(self.record).encode()).hexdigest()[:32]

    def algorithm(self, method: Method) -> str:
        """The key in ALGORITHMS of a method's algorithm."""
        given = method.fixed.get("algorithm", self.fixed.get("algorithm"))
        name = CHOICES["algorithm"].usual if given is None else given.values[0]
        require(isinstance(name, str), f"methods.{method.name} has algorithm {name!r}; it must be a name")
        return name

    def searched(self, method: Method) -> dict[str, Prior]:
        """Return the priors of a method: the common fields that it has a use for and doesn't fix, and its own."""
        others = {*method.fixed, *self.idle(method), *idle({"algorithm": self.algorithm(method)}, ["algorithm"])}
        return {name: prior for name, prior in self.prior.items() if name not in others} | dict(method.search)

    def anchored(self, method: Method) -> list[dict[str, Prior]]:
        """Return a method's first draws: of each anchor what it has a use for and doesn't fix, and its own."""
        others = {*method.fixed, *self.idle(method), *idle({"algorithm": self.algorithm(method)}, ["algorithm"])}
        return [
            {field: prior for field, prior in common.items() if field not in others}
            | dict(method.anchors.get(name, {}))
            for name, common in self.anchors.items()
        ]

    def idle(self, method: Method) -> Collection[str]:
        """The fields that a method's loss and policy have no use for; none where it draws one of the two."""
        if {"loss", "policy"} & {*self.prior, *method.search}:
            return ()
        fixed = {**self.fixed, **method.fixed}
        named: dict[str, Any] = {name: fixed[name].values[0] for name in ("loss", "policy") if name in fixed}
        return idle(named, ["loss", "policy"]) if {*named.values()} <= {*LOSSES, *POLICIES, "auto"} else ()


def check(protocol: Protocol) -> None:
    """Raise UsageError for parts of a file that don't go together."""
    require(len(protocol.methods) > 1, "methods has fewer than two; add a [methods.NAME] table for each")
    require(bool(protocol.tuning), "tasks has none to tune on; add a [tasks.NAME] table without held_out = true")
    for kind, entries in (("methods", protocol.methods), ("tasks", protocol.tasks)):
        labels = [entry.label for entry in entries]
        for label in (label for label in labels if labels.count(label) > 1):
            raise UsageError(f"{kind} has two with the label {label!r}; give each a label of its own")
    n = len(protocol.methods) * protocol.budget.settings
    most = f"draw {MOST_SETTINGS:,} settings at most in all"
    require(n <= MOST_SETTINGS, f"budget.settings times the number of methods is {n:,}; {most}")
    for field in protocol.prior:
        require(field not in protocol.fixed, f"fixed has {field}, and so has prior; leave it in one of them")
        require(
            field != "algorithm", "prior has algorithm, whose defaults would not be drawn with it; give it to methods"
        )
    if protocol.design == "factorial":
        _check_factorial(protocol)
    for method in protocol.methods:
        timed = method.time is not None and protocol.design == "stages"
        require(not timed, f'methods.{method.name} has time, which goes with design = "factorial"; take it out')
    for task in protocol.tasks:
        _check_task(protocol, task)
    for task, other in itertools.combinations(protocol.tasks, 2):
        tuned = not task.held_out and not other.held_out
        same = _asks(task) == _asks(other) and (not tuned or task.steps(False) == other.steps(False))
        require(not same, f"tasks.{other.name} is the same as tasks.{task.name}; change one of them, or take it out")
    for method in protocol.methods:
        where = f"methods.{method.name}"
        for field in ("loss", "policy"):
            for given in (table[field].values[0] for table in (method.fixed, protocol.fixed) if field in table):
                require(isinstance(given, str), f"{where} has {field} {given!r}; it must be a name")
        for field in sorted({*method.search} & {*protocol.prior, *protocol.fixed, *method.fixed}):
            raise UsageError(
                f"{where}.search has {field}, and so has prior, fixed or {where}.fixed; leave it in one of them"
            )
        require("algorithm" not in method.search, f"{where}.search has algorithm; make a method of each instead")
        for field in sorted({*method.search} & {*protocol.idle(method)}):
            raise UsageError(f"{where}.search has {field}, which its loss and policy have no use for; take it out")
        some = bool(protocol.searched(method)) or protocol.budget.settings == 1
        require(some, f"{where} searches nothing, so its draws would all be alike; add to prior, or to {where}.search")
    for field in protocol.prior:
        free = any(field in protocol.searched(method) for method in protocol.methods)
        require(free, f"prior.{field} is drawn for no method, since each fixes it or has no use for it; take it out")
    _check_anchors(protocol)


def _check_anchors(protocol: Protocol) -> None:
    """Raise UsageError for anchors that no method can have as a draw."""
    n, most = len(protocol.anchors), protocol.budget.settings
    require(n < most or not n, f"budget.settings is {most}, and anchors are {n} of them; draw one or more beside them")
    for method in protocol.methods:
        for name, fields in (*protocol.anchors.items(), *method.anchors.items()):
            for field in sorted({"algorithm", "loss", "policy"} & {*fields}):
                raise UsageError(f"anchors.{name} has {field}, which is the methods'; take it out")
        where, searched = f"methods.{method.name}", protocol.searched(method)
        for name, own in method.anchors.items():
            require(name in protocol.anchors, f"{where}.anchors has {name}, which is no table of anchors; add it there")
            for field in sorted({*own} & {*method.fixed}):
                raise UsageError(
                    f"{where}.anchors.{name} has {field}, and so has {where}.fixed; leave it in one of them"
                )
        for name, given in zip(protocol.anchors, protocol.anchored(method), strict=True):
            for field, value in given.items():
                in_steps = field in searched and searched[field].in_steps
                as_drawn = 'as it is drawn, with times = "steps"' if in_steps else "without times"
                right = value.in_steps == in_steps
                require(right, f"anchors.{name}.{field} is not counted as the prior's values are; write it {as_drawn}")


def _check_factorial(protocol: Protocol) -> None:
    """Raise UsageError for what a factorial design can't do."""
    told = "a factorial design selects and judges by the same runs"
    for task in protocol.held_out:
        raise UsageError(
            f"tasks.{task.name} is held out, but {told}, and leaves each task out once; take held_out away"
        )
    given = {"budget": protocol.record.get("budget", {})}
    given |= {f"tasks.{name}": table for name, table in protocol.record["tasks"].items()}
    for name in ("fresh_seeds", "fresh_steps"):
        for where, table in given.items():
            require(name not in table, f"{where} has {name}, but {told}; take it out")
    require(len(protocol.tasks) > 1, f"tasks has one, but {told}, and leaves each task out once; add another")
    n = protocol.budget.seeds
    require(
        n > 1, f"budget.seeds is {n}, but {told}: one half of the seeds judges what the other selects; give 2 or more"
    )
    require(
        protocol.baseline.time is None, f"methods.{protocol.baseline.name} has time, but is the baseline; take it out"
    )


def _asks(task: Task) -> tuple[object, ...]:
    """All that a task's runs on fresh seeds depend on."""
    return key_of(task.env), task.env_kwargs, task.fixed, task.scale, task.steps(fresh=True)


def _check_task(protocol: Protocol, task: Task) -> None:
    """Raise UsageError for a task that can't be judged, or that fixes what is not its own to fix."""
    where, metric = f"tasks.{task.name}", protocol.selection.metric
    require(
        metric == "training_return" or task.budget.eval_episodes > 0,
        f"{where} has eval_episodes 0, but selection.metric is {metric!r}; give it some, or judge by 'training_return'",
    )
    for fresh in (False, True):
        n = task.steps(fresh)
        require(n <= MOST_STEPS, f"{where} has {n:,} steps; a run may have {MOST_STEPS:,} at most")
    for field in sorted({*task.scale} - {*protocol.prior}):
        raise UsageError(f"{where}.scale has {field}, which prior does not draw; draw it there, or take it out")
    for field in sorted({"algorithm", "loss", "policy", *protocol.prior} & {*task.fixed}):
        raise UsageError(f"{where}.fixed has {field}, which is the methods' or the prior's; take it out")
    for anchor, fields in protocol.anchors.items():
        for field in sorted({*fields} & {*task.fixed}):
            raise UsageError(f"{where}.fixed has {field}, and so has anchors.{anchor}; leave it in one of them")
    for method in protocol.methods:
        for field in sorted({*task.fixed} & {*method.fixed, *method.search}):
            raise UsageError(f"{where}.fixed has {field}, and so has methods.{method.name}; leave it in one of them")
