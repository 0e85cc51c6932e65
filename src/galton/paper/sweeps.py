"""What is trained for figures: the record of a sweep, and the grids of the paper's tasks at three budgets."""

import dataclasses
from collections.abc import Callable, Iterable, Mapping
from typing import Literal

from galton.paper.summary import Summary
from galton.sweep.grid import expand, paper_blocks, paper_grid, task_defaults
from galton.sweep.study import Setting, Study
from galton.tasks import TASKS

Budget = Literal["smoke", "small", "paper"]
Done = Mapping[str, Summary]
"""The summaries of the sweeps that are done, by name."""
FRESH = 1
"""The seed of the studies that judge what others, of seed 0, have chosen."""
CENTRED_ETAS = [0.75, 1.0, 2.0, 4.0]
"""The η of centred HL-Gauss, which the paper does not have: wider than those of its grid."""


@dataclasses.dataclass(frozen=True)
class Sweep:
    """What is trained together for figures: one folder of runs, and one file of results."""

    name: str
    """The name of its file, without the suffix, and of its folder."""
    study: Callable[[Budget, Done], Study]
    """Makes the study to train, from the budget and from what was trained before."""
    title: str = ""
    """What the page calls it where it says with which budget it was trained; without one it is not mentioned there."""
    winners_of: "Sweep | None" = None
    """The sweep whose best settings it trains, which is done before it."""


def best_of_each_loss(summary: Summary) -> tuple[Setting, ...]:
    """Each loss's setting with the highest mean final training return (App. C.2)."""
    return tuple(best.setting for best in summary.best.values())


def again(sweep: Sweep, winners: Callable[[Summary], tuple[Setting, ...]] = best_of_each_loss) -> Sweep:
    """A sweep's winners on fresh seeds, by which they are judged: the mean of the best of many flatters."""

    def study(_: Budget, done: Done) -> Study:
        main = done[sweep.name]
        return dataclasses.replace(main.study, settings=winners(main), seed=FRESH)

    return Sweep(f"{sweep.name}-again", study, winners_of=sweep)


def needed(sweeps: Iterable[Sweep]) -> list[Sweep]:
    """These sweeps and those whose winners they train, which come before them."""
    found: dict[Sweep, None] = {}
    for sweep in sweeps:
        before = [] if sweep.winners_of is None else needed([sweep.winners_of])
        found |= dict.fromkeys([*before, sweep])
    return list(found)


def main_settings(task: str, budget: Budget) -> tuple[Setting, ...]:
    """The grid of a task's main sweep: the paper's, centred HL-Gauss beside it, or a part of both."""
    known, base = TASKS[task], task_defaults(TASKS[task].env)
    rates, bins, etas, wide = list(known.learning_rates), [100], [0.25, 0.75], CENTRED_ETAS
    if budget == "paper":
        grid = paper_grid(known.env, base)
    else:
        rates, bins = (rates[-3:], bins) if budget == "small" else (rates[1:3], [20])
        if (task, budget) == ("ant", "small"):
            rates = rates[::2]
        wide = [2.0]
        grid = expand(paper_blocks(rates, bins, etas if known.in_jax else etas[:1]), base)
    centred = {"loss": "hl-gauss-centred", "learning_rate": rates, "n_bins": bins, "eta": wide}
    return grid + expand([centred], base)


_TRIALS: dict[Budget, dict[str, int]] = {
    "paper": dict.fromkeys(TASKS, 20) | {"bandit": 50},
    "small": dict.fromkeys(TASKS, 5) | {"bandit": 20, "ant": 3},
    "smoke": dict.fromkeys(TASKS, 2),
}


def task_study(task: str, budget: Budget, settings: tuple[Setting, ...]) -> Study:
    """These settings on a task, at App. C.2's length but for the smoke test."""
    known, trials = TASKS[task], _TRIALS[budget][task]
    if budget == "smoke":
        return Study(known.env, settings, trials, steps=400, logs=4, eval_episodes=1)
    logs = 50 if task == "bandit" else known.n_logs
    return Study(known.env, settings, trials, known.total_timesteps, logs, known.n_eval_episodes)


def _main(task: str) -> Sweep:
    return Sweep(task, lambda budget, _: task_study(task, budget, main_settings(task, budget)), TASKS[task].title)


MAIN = {task: _main(task) for task in TASKS}
"""The main sweep of each task: the grid of App. C.2, and centred HL-Gauss."""
AGAIN = {task: again(MAIN[task]) for task in TASKS}
"""The sweep of each task that trains each loss's best setting of the grid on fresh seeds."""
