"""The answer of a benchmark in a few sentences: who is ahead on the tuning tasks, and does that hold elsewhere?"""

from collections.abc import Mapping, Sequence

import numpy as np
from scipy import stats

from galton_experiments.analysis.statistics import ALPHA, least_p
from galton_experiments.analysis.verdicts import mark
from galton_experiments.benchmark import factorial_page
from galton_experiments.benchmark.found import Found
from galton_experiments.benchmark.stages import Stage
from galton_experiments.benchmark.tables import STAGES

_FEWEST = 8
"""Of runs of one method over all tasks. With fewer, intervals of drawing them again are too narrow."""
_FEWEST_SEEDS = 3
"""Of runs of one method on a task, for the same reason."""


def sentences(found: Found) -> list[str]:
    """Put the results of the stages that are done into sentences; the first is the answer.

    Who is ahead is told by the scores of shared settings on fresh seeds of the tuning tasks, and never by held-out
    ones. Those compare it with the baseline, for seeds that have chosen it flatter it; they do so where none are held
    out, and then it is said.
    """
    if found.protocol.design == "factorial":
        return factorial_page.sentences(found)
    base = found.protocol.baseline
    labels = {method.name: method.label for method in found.protocol.methods}
    if not found.standings:
        return ["All draws are trained on the tuning tasks; fresh seeds have not judged yet what was selected."]
    scores = found.standings["fresh"].scores if "fresh" in found.standings else {}
    if not scores:
        return ["The held-out tasks are done, but not all tuning tasks on fresh seeds."]
    order = sorted(scores, key=lambda name: (-round(float(scores[name]["shared"].judged.mean), 12), name != base.name))
    if order[0] == base.name:
        first = f"No method has a higher score than {base.label} on the {STAGES['fresh']}."
    else:
        first = f"{labels[order[0]]} has the highest score on the {STAGES['fresh']}."
    ahead = next(name for name in order if name != base.name)
    said = [first, _behind(found, order, labels)]
    if "held-out" in found.standings:
        return [*said, _against(found, "held-out", ahead)]
    return [*said, _against(found, "fresh", ahead) + " The same seeds chose it, which flatters it."]


def _behind(found: Found, order: Sequence[str], labels: Mapping[str, str]) -> str:
    """Name the methods that may be as good as the first, by P(X > Y) over the tuning tasks.

    The first of M methods is ahead of some by chance. So each interval is widened as Tukey widens those of all pairs of
    M means, by the studentised range; and as variances are for n seeds, since drawing these again is as drawing from
    a population whose variance is smaller by (n − 1) / n.
    """
    standings, n = found.standings["fresh"], found.protocol.budget.fresh_seeds
    if n < _FEWEST_SEEDS or n * len(standings.tasks) < _FEWEST:
        return "There are too few fresh seeds to say which methods are behind it."
    above = standings.above[order[0]]
    of_all, of_two = (stats.studentized_range.ppf(1 - ALPHA, m, np.inf) for m in (len(order), 2))
    wider = of_all / of_two * np.sqrt(n / (n - 1))
    behind = {name for name in order[1:] if above[name].mean - wider * (above[name].mean - above[name].low) > 0.5}
    return f"Not clearly behind it: {_list([labels[name] for name in order[1:] if name not in behind])}."


def _against(found: Found, stage: Stage, ahead: str) -> str:
    """Compare one method with the baseline in a stage, in words."""
    standings, base = found.standings[stage], found.protocol.baseline
    label = next(method.label for method in found.protocol.methods if method.name == ahead)
    tasks = {task.name: task.label for task in found.protocol.tasks}
    marks = {tasks[name]: mark(versus.direction, versus.p) for name, versus in standings.versus[ahead].items()}
    better, worse = ([label for label, each in marks.items() if each == wanted] for wanted in "✓✗")
    first = f"On the {STAGES[stage]}, {label} is above {base.label} with P = {standings.above[ahead][base.name]:.2f}."
    n = found.protocol.budget.fresh_seeds
    if least_p(n, n, paired=True) * len(standings.tasks) >= ALPHA:
        return f"{first} There are too few fresh seeds for anything to be clear on a task by itself."
    clearly = f"it is clearly better on {_list(better)} and clearly worse on {_list(worse)}."
    return f"{first} Of {len(standings.tasks)} {clearly}"


def _list(names: Sequence[str]) -> str:
    return ", ".join(names) or "none"
