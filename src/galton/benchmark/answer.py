"""The answer of a benchmark in a few sentences: who is ahead on the tuning tasks, and does that hold elsewhere?"""

from collections.abc import Sequence

from galton.analysis.statistics import ALPHA
from galton.benchmark.found import Found
from galton.benchmark.stages import Stage
from galton.benchmark.tables import STAGES


def sentences(found: Found) -> list[str]:
    """What the stages that are done say; the first sentence is the answer.

    Who is ahead is told by the interquartile mean of shared settings on fresh seeds of the tuning tasks, and never by
    held-out ones.
    """
    base = found.protocol.baseline
    labels = {method.name: method.label for method in found.protocol.methods}
    if not found.standings:
        return ["All draws are trained on the tuning tasks; fresh seeds have not judged yet what was selected."]
    scores = found.standings["fresh"].scores if "fresh" in found.standings else {}
    if not scores:
        return ["The held-out tasks are done, but not all tuning tasks on fresh seeds."]
    order = sorted(scores, key=lambda name: float(scores[name]["shared"].judged.mean), reverse=True)
    if order[0] == base.name:
        first = f"No method has a higher score than {base.label} on the {STAGES['fresh']}."
    else:
        first = f"{labels[order[0]]} has the highest score on the {STAGES['fresh']}."
    ahead = next(name for name in order if name != base.name)
    return [first, *(_against(found, stage, ahead) for stage in found.standings)]


def _against(found: Found, stage: Stage, ahead: str) -> str:
    """How one method does against the baseline in a stage."""
    standings, base = found.standings[stage], found.protocol.baseline
    label = next(method.label for method in found.protocol.methods if method.name == ahead)
    tasks = {task.name: task.label for task in found.protocol.tasks}
    clear = {name: versus for name, versus in standings.versus[ahead].items() if versus.p < ALPHA}
    better = [tasks[name] for name, versus in clear.items() if versus.difference.mean > 0]
    worse = [tasks[name] for name, versus in clear.items() if versus.difference.mean < 0]
    return (
        f"On the {STAGES[stage]}, {label} is above {base.label} with P = {standings.above[ahead][base.name]:.2f}. Of "
        f"{len(standings.tasks)} it is clearly better on {_list(better)} and clearly worse on {_list(worse)}."
    )


def _list(names: Sequence[str]) -> str:
    return ", ".join(names) or "none"
