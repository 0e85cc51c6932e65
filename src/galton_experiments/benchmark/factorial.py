"""The answers of a factorial benchmark: all draws of all methods on all tasks and seeds, read in several ways."""

from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from galton_experiments.analysis.factorial import Factorial, factorial
from galton_experiments.benchmark.protocol import Protocol
from galton_experiments.benchmark.runs import Runs
from galton_experiments.benchmark.selection import Judged, normalised

Times = Mapping[str, Mapping[str, int | float]]
"""The time of a step as a multiple of the baseline's, by method and task."""


class Answers(NamedTuple):
    """The runs are compared at equal steps and at equal time; methods, draws and tasks are in the file's order."""

    times: Times
    """Empty where the time of a step is neither given nor known."""
    equal_steps: Factorial
    """Every run is read at its end."""
    equal_time: Mapping[str, Factorial]
    """Of the baseline and one other method each, by the latter's name: both are read when the faster one ends.

    Without a method one of whose runs, or of the baseline's, has seen no episode end by then."""


def answers(
    protocol: Protocol, runs: Sequence[Runs], scores: Judged, speeds: Mapping[str, Mapping[str, int | float]]
) -> Answers:
    """Compare the methods of a factorial benchmark by its runs.

    Args:
        protocol: its file.
        runs: the runs of each task.
        scores: their percentiles.
        speeds: steps a second, by task and method, as far as they are known.
    """
    base, times = protocol.baseline.name, _times(protocol, speeds)
    names = [method.name for method in protocol.methods]
    equal_time = {}
    for name, by_task in times.items():
        judged = {}
        for each in runs:
            shares = dict.fromkeys(names, 1.0) | {name: 1 / by_task[each.task], base: by_task[each.task]}
            last = protocol.selection.last
            finals = {of: each.finals_at(of, min(1.0, share), last) for of, share in shares.items()}
            judged[each.task] = {of: numbers for of, numbers in finals.items() if numbers is not None}
        if all(len(of_method) == len(names) for of_method in judged.values()):
            equal_time[name] = factorial(stacked(normalised(judged), [base, name]))
    return Answers(times, factorial(stacked(scores, names), names.index(base)), equal_time)


def stacked(scores: Judged, names: Sequence[str]) -> Float[np.ndarray, "methods draws tasks seeds"]:
    """The scores of these methods in one array."""
    return np.array([[of_method[name] for of_method in scores.values()] for name in names]).swapaxes(1, 2)


def _times(protocol: Protocol, speeds: Mapping[str, Mapping[str, int | float]]) -> Times:
    """Return the relative time of a step, as the file has it or by the speed of the runs."""
    base, found = protocol.baseline.name, {}
    known = {task.name for task in protocol.tasks} <= {*speeds}
    for method in (method for method in protocol.methods if method.name != base):
        if method.time is not None:
            found[method.name] = {task.name: method.time for task in protocol.tasks}
        elif known:
            found[method.name] = {
                task.name: speeds[task.name][base] / speeds[task.name][method.name] for task in protocol.tasks
            }
    return found
