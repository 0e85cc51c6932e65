"""A benchmark's results are put into tables, for the terminal and for the page alike."""

import math
from collections.abc import Sequence

import numpy as np

from galton.records import Fields
from galton_experiments.analysis.plain import rounded
from galton_experiments.analysis.statistics import Numbers
from galton_experiments.benchmark.found import Found
from galton_experiments.benchmark.priors import Priors
from galton_experiments.benchmark.protocol import Method
from galton_experiments.benchmark.runs import Runs
from galton_experiments.benchmark.stages import Role, Stage
from galton_experiments.benchmark.standings import Standings, Versus
from galton_experiments.page.page import Table

METRICS = {
    "evaluation_return": "deterministic return",
    "mean_action_return": "mean-action return",
    "training_return": "training return",
}
"""The returns that runs may be judged by, in words."""
STAGES: dict[Stage, str] = {"fresh": "tuning tasks, fresh seeds", "held-out": "held-out tasks"}
"""The names of the later stages."""
_SHORT: dict[Stage, str] = {"tuning": "tuning", "fresh": "fresh seeds", "held-out": "held-out tasks"}
_HEADINGS = ("return", "training return", "worst run", "diverged", "difference", "P(above)", "p (Holm)")
"""The columns for each setting in a table of returns; the last three compare it with the baseline's."""
_ROLES: dict[Role, str] = {"shared": "one for all tasks", "per-task": "of the task"}


def metric(found: Found) -> str:
    """The return that runs are judged by, in words."""
    return METRICS[found.protocol.selection.metric]


def trained(found: Found) -> str:
    """Say how many runs there are of what, and which part of them judges."""
    protocol = found.protocol
    budget, last = protocol.budget, protocol.selection.last
    said = f"Each draw has {_count(budget.seeds, 'seed')} on each tuning task"
    if protocol.design == "stages":
        said += f", and what is selected has {_count(budget.fresh_seeds, 'fresh seed')} on every task"
    part = f"over the last {100 * last:g}% of its log points" if last < 1 else "over all its log points"
    return f"{said}. A run is judged by its mean {metric(found)} {part}. The baseline is {protocol.baseline.label}."


def _count(n: int, what: str) -> str:
    return f"{n:,} {what}{'s' * (n != 1)}"


def tasks(found: Found) -> Table:
    """Tabulate the tasks, with the length of their runs and how often these are evaluated."""
    in_stages = found.protocol.design == "stages"
    headings = ["task", "environment", "steps, at least", *["steps, fresh seeds, at least"] * in_stages]
    headings += ["log points, at most", "episodes at each"]
    rows = []
    for task in found.protocol.tasks:
        arguments = ", ".join(f"{name}={value!r}" for name, value in task.env_kwargs.items())
        rows.append([task.label, f"{task.env}({arguments})" if arguments else task.env])
        rows[-1].append("held out" if task.held_out else f"{task.steps(False):,}")
        rows[-1] += [f"{task.steps(True):,}"] * in_stages
        rows[-1] += [f"{task.budget.logs}", f"{task.budget.eval_episodes}"]
    return Table(headings, rows)


def fixed(found: Found) -> Table:
    """Tabulate what no draw changes, and for whom."""
    protocol = found.protocol
    owners = [
        ("all, unless said below", protocol.fixed),
        *((method.label, method.fixed) for method in protocol.methods),
    ]
    owners += [(f"all on {task.label}", task.fixed) for task in protocol.tasks]
    return Table(
        ["for", "what"], [[who, ", ".join(f"{n} {of.told()}" for n, of in own.items())] for who, own in owners if own]
    )


def budget(found: Found) -> Table:
    """Tabulate each method's budget: draws, and in each stage environment steps, every run counted as if alone."""
    headings = ["method", "draws", "different settings"]
    if found.protocol.design == "factorial":
        headings += ["steps", "diverged"]
    else:
        headings += [*(f"steps, {_SHORT[stage]}" for stage in found.runs), "diverged, tuning"]
    rows = []
    for method in found.protocol.methods:
        draws = found.draws[method.name]
        different = len({repr(sorted(drawn.items())) for drawn in draws})
        steps = (sum(_steps(each, method) for each in runs) for runs in found.runs.values())
        diverged = sum(each.diverged(method.name, "draw") for each in found.tuning)
        rows.append([method.label, f"{len(draws)}", f"{different}", *(f"{n:,}" for n in steps), f"{diverged}"])
    return Table(headings, rows)


def _steps(runs: Runs, method: Method) -> int:
    """Count the environment steps of a method's runs on a task, diverged ones in full."""
    roles = dict.fromkeys(entry.role for entry in runs.part.entries)
    return sum(runs.trained(method.name, role) for role in roles)


def prior(found: Found) -> Table:
    """Tabulate what is drawn, by whom and from what."""
    protocol = found.protocol

    def rows(who: str, priors: Priors) -> list[list[str]]:
        return [[name, who, of.told()] for name, of in priors.items()]

    own = [row for method in protocol.methods for row in rows(method.label, method.search)]
    scaled = [[name, f"on {task.label}", f"× {by:g}"] for task in protocol.tasks for name, by in task.scale.items()]
    return Table(["field", "drawn for", "from"], [*rows("all that have a use for it", protocol.prior), *own, *scaled])


def settings(found: Found) -> Table:
    """The draw that was selected for all tuning tasks, and those for each of them."""
    rows = []
    for method in found.protocol.methods:
        chosen = {"all tuning tasks": found.selected.shared[method.name]}
        chosen |= {task.label: found.selected.per_task[task.name][method.name] for task in found.protocol.tuning}
        rows += [
            [method.label, where, f"{i}", drawn_as_text(found.draws[method.name][i])] for where, i in chosen.items()
        ]
    return Table(["method", "selected for", "draw", "what it drew"], rows)


def drawn_as_text(drawn: Fields) -> str:
    """The values of a draw in a line."""
    return ", ".join(
        f"{name} {value:.12g}" if isinstance(value, float) else f"{name} {value}" for name, value in drawn.items()
    )


def scores(found: Found, stage: Stage) -> Table:
    """Tabulate the scores of the shared settings over all tasks of a stage."""
    standings, base = found.standings[stage], found.protocol.baseline
    headings = ["method", "score", "IQM", "training score", "P(above)", "P, training"]
    headings += ["P(above), own settings", "sensitivity"] * bool(standings.sensitivity) + ["diverged"]
    rows = []
    for method in found.protocol.methods:
        name, score = method.name, standings.scores[method.name]["shared"]
        row = [method.label, f"{score.judged:.3f}", f"{score.middle:.3f}", f"{score.training:.3f}"]
        if method == base:
            row += ["—", "—"]
        else:
            row += [f"{standings.above[name][base.name]:.2f}", f"{standings.above_in_training[name]:.2f}"]
        if standings.sensitivity:
            row.append("—" if method == base else f"{standings.above_per_task[name]:.2f}")
            row.append(f"{standings.sensitivity[name]:+.3f}")
        diverged = sum(of_task[name]["shared"].diverged for of_task in standings.results.values())
        rows.append([*row, f"{diverged}"])
    return Table(headings, rows)


def speeds(found: Found) -> Table:
    """Environment steps a second of one worker while it trained each method's draws, by task."""
    tasks = [task for task in found.protocol.tuning if task.name in found.speeds]
    rows = [
        [method.label, *(f"{found.speeds[task.name][method.name]:,.0f}" for task in tasks)]
        for method in found.protocol.methods
    ]
    return Table(["method", *(task.label for task in tasks)], rows)


def pairs(found: Found, stage: Stage) -> Table:
    """P(X > Y) for each two methods, by what the runs of their shared settings are judged by."""
    above, methods = found.standings[stage].above, found.protocol.methods
    rows = [
        [method.label, *("—" if method == other else f"{above[method.name][other.name]:.2f}" for other in methods)]
        for method in methods
    ]
    return Table(["P(row above column)", *(method.label for method in methods)], rows)


def returns(found: Found, stage: Stage) -> Table:
    """Each method's returns on each task of a stage, its worst run, and how it does against the baseline."""
    rows = [
        [task, method.label, _ROLES[role], *_returns(found, stage, name, method, role)]
        for name, task in _tasks(found, stage).items()
        for method in found.protocol.methods
        for role in found.standings[stage].scores[method.name]
    ]
    return Table(["task", "method", "setting", *_HEADINGS], rows)


def returns_in_brief(found: Found, stage: Stage) -> Table:
    """The same of the shared settings alone, methods below their task: a terminal is narrow."""
    rows, diverged = [], _HEADINGS.index("diverged")
    for name, task in _tasks(found, stage).items():
        rows.append([task, *[""] * (len(_HEADINGS) - 1)])
        for method in found.protocol.methods:
            cells = _returns(found, stage, name, method, "shared")
            gone = cells.pop(diverged)
            rows.append([f"  {method.label}{f' ({gone} diverged)' if gone != '0' else ''}", *cells])
    return Table(["task, method", *(heading for heading in _HEADINGS if heading != "diverged")], rows)


def _tasks(found: Found, stage: Stage) -> dict[str, str]:
    """The labels of a stage's tasks."""
    return {runs.task: runs.part.task.label for runs in found.later[stage]}


def _returns(found: Found, stage: Stage, task: str, method: Method, role: Role) -> list[str]:
    """The cells of a method's setting on a task, below _HEADINGS."""
    standings = found.standings[stage]
    form = _form_of(standings, task)
    result = standings.results[task][method.name][role]
    row = [returns_of(standings, task, method, role), f"{result.training:{form}}", number(result.worst, form)]
    return [*row, f"{result.diverged}", *_versus(standings, method.name, task, role, form)]


def returns_of(standings: Standings, task: str, method: Method, role: Role) -> str:
    """Format the return that a method's setting is judged by on a task, with its interval."""
    return f"{standings.results[task][method.name][role].judged:{_form_of(standings, task)}}"


def _form_of(standings: Standings, task: str) -> str:
    of_method = standings.results[task].values()
    return form([result.judged.mean for of_role in of_method for result in of_role.values()])


def _versus(standings: Standings, method: str, task: str, role: Role, form: str) -> list[str]:
    if role != "shared" or method not in standings.versus:
        return ["—"] * 3
    versus = standings.versus[method][task]
    return [f"{versus.difference:+{form}}", number(versus.above, ".2f"), _p(versus)]


def form(returns: Sequence[Numbers | float]) -> str:
    """Return the number format of a task's returns, all with as many decimals: four digits of the largest."""
    size = max((abs(float(value)) for value in returns if np.isfinite(value)), default=0.0)
    return f",.{max(0, 3 - math.floor(math.log10(size))) if size else 3}f"


def number(value: float, form: str) -> str:
    """A number that may be unknown, as a table has it."""
    return "—" if math.isnan(value) else f"{rounded(value):{form}}".replace("-", "−")


def _p(versus: Versus) -> str:
    return "< 0.001" if versus.p < 0.001 else number(versus.p, ".3f")


def best_of(found: Found) -> Table:
    """Tabulate what tuning with fewer draws gets, by the normalised score of one setting for all tasks."""
    n = found.protocol.budget.settings
    sizes = sorted({size for size in (1, 2, 4, 8, 16, 32, 64) if size < n} | {n})
    rows = [
        [method.label, *(number(found.best_of[method.name].shared[size - 1], ".3f") for size in sizes)]
        for method in found.protocol.methods
    ]
    return Table(["method", *(f"of {size}" for size in sizes)], rows)
