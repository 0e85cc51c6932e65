"""Recovery times say how long runs take to come back after their task has changed."""

import numpy as np
from jaxtyping import Float, Int
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
    for change in range(period, int(steps[-1]), period):
        here = (steps > change) & (steps < change + period)
        if not here.any():
            continue
        back, since = returns[:, here] >= level, steps[here] - change
        is_back = np.asarray(back.any(1))
        times = np.where(is_back, since[back.argmax(1)], since[-1])
        found.append(stats.CensoredData.right_censored(times, ~is_back))
    return found
