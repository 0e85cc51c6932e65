"""Logs of runs whose task changes tell how long these take to come back, what a phase was like, and the regret."""

from collections.abc import Iterator

import numpy as np
from jaxtyping import Bool, Float, Int, Real
from scipy import stats


def recoveries(
    returns: Float[np.ndarray, "R L"], steps: Int[np.ndarray, " L"], period: int, level: float
) -> list[stats.CensoredData]:
    """The steps from each change of a task to the first log point at which a run's return is back at a level.

    A run that is not back at the last log point before the next change is censored there. A log point at a change
    belongs to neither side: training has just come to it, and evaluation is behind it already. `scipy.stats.ecdf` makes
    a Kaplan–Meier curve of an entry, and `scipy.stats.logrank` compares those of two agents.

    Args:
        returns: the return of each run at each log point.
        steps: those that a copy of the environment had taken by then, ascending.
        period: steps of a copy from one change to the next; the first is after as many.
        level: the return that counts as back.

    Returns:
        An entry for each change behind which there is a log point, of R times.
    """
    found = []
    for change, here in _inside(steps, period):
        if change == 0:
            continue
        back, since = returns[:, here] >= level, steps[here] - change
        is_back = np.asarray(back.any(1))
        times = np.where(is_back, since[back.argmax(1)], since[-1])
        found.append(stats.CensoredData.right_censored(times, ~is_back))
    return found


def phases(values: Real[np.ndarray, "R L"], steps: Int[np.ndarray, " L"], period: int) -> list[Real[np.ndarray, "R _"]]:
    """A column of the log, cut into the phases of a task that changes; a log point at a change is in neither.

    Of returns, `phase.mean(1)` is what each run got in a phase, to be held beside the first phase of a fresh start. Of
    the entropy, `phase[:, -1]` is what was left of it before the change.

    Args:
        values: the column's value of each run at each log point.
        steps: those that a copy of the environment had taken by then, ascending.
        period: steps of a copy from one change to the next; the first is after as many.

    Returns:
        The values of each phase in which there is a log point.
    """
    return [values[:, here] for _, here in _inside(steps, period)]


def dynamic_regret(regret: Float[np.ndarray, "R L"], steps: Int[np.ndarray, " L"]) -> Float[np.ndarray, "R L"]:
    """The regret of all steps until each log point, beside the best policy of each moment.

    Args:
        regret: `env_regret` of each run, which is a mean over the steps since the log point before.
        steps: those that a copy of the environment had taken by then, ascending.
    """
    summed: Float[np.ndarray, "R L"] = np.cumsum(regret * np.diff(steps, prepend=0), 1)
    return summed


def _inside(steps: Int[np.ndarray, " L"], period: int) -> Iterator[tuple[int, Bool[np.ndarray, " L"]]]:
    """The beginning of each phase and the log points inside; a phase without one is left out."""
    for begin in range(0, int(steps[-1]), period):
        here = (steps > begin) & (steps < begin + period)
        if here.any():
            yield begin, here
