"""A `Sweep` records what is trained for figures; the grids are those of the paper's tasks at four budgets."""

import dataclasses
import functools
import json
import re
from collections.abc import Callable, Iterable, Mapping
from typing import Any, Literal

from galton.errors import require
from galton.tasks import TASKS
from galton_experiments.runs import Summary
from galton_experiments.sweep import Setting, Study, expand, paper_blocks, paper_grid, task_defaults

Budget = Literal["smoke", "small", "grid", "paper"]
Done = Mapping[str, Summary]
"""The summaries of the sweeps that are done, by name."""
FRESH = 1
"""The seed of the studies that judge what others, of seed 0, have chosen."""
FRESH_TRIALS: "Mapping[Budget, Mapping[str, int]]" = {
    "grid": {"reacher": 10, "half-cheetah": 10, "ant": 6},
    "paper": dict.fromkeys(("lqr", "mountain-car", "acrobot"), 50),
}
"""Runs of the main experiment's winners on fresh seeds, where there are more than of the grid: its own are few, or one
run in ten fails, as the Gaussian's on the LQR, and twenty would leave the verdict to luck."""
CENTRED_ETAS = [0.75, 1.0, 2.0, 4.0]
"""The η of centred HL-Gauss, which the paper does not have: wider than those of its grid."""


@dataclasses.dataclass(frozen=True)
class Sweep:
    """A sweep is what is trained together for figures: one folder of runs, and one file of results."""

    name: str
    """The name of its file, without the suffix, and of its folder."""
    study: Callable[[Budget, Done], Study]
    """Makes the study to train, from the budget and from what was trained before."""
    title: str = ""
    """The page's words for it beside its name, where it says how it was made."""
    winners_of: "Sweep | None" = None
    """The sweep whose best settings it trains, which is done before it."""

    def __post_init__(self) -> None:
        is_a_name = re.fullmatch(r"\w[\w.+-]*", self.name)
        require(
            is_a_name is not None, f"name is {self.name!r}, which is no name of a file; use letters, digits, - and ."
        )


def best_of_each_loss(summary: Summary) -> tuple[Setting, ...]:
    """Each loss's setting with the highest mean final training return (App. C.2)."""
    return tuple(best.setting for best in summary.best.values())


def winners_for(summary: Summary, budget: Budget) -> tuple[Setting, ...]:
    """The same, of two losses alone in the smoke test."""
    losses = ("gaussian", "hl-gauss") if budget == "smoke" else tuple(summary.best)
    return tuple(summary.best[loss].setting for loss in losses)


def on_fresh_seeds(study: Study, settings: tuple[Setting, ...], trials: int | None = None) -> Study:
    """A study of these settings by which they are judged: seeds that chose nothing, trial t the same for all settings.

    The deterministic policy is the mode's and the mean's.
    """
    trials = study.trials if trials is None else trials
    return dataclasses.replace(
        study, settings=settings, trials=trials, seed=FRESH, common_seeds=True, eval_mean=study.eval_episodes > 0
    )


def unpaired(study: Study, trials: int) -> Study:
    """The same study as 0.1.0 trained it: so many trials, each run with a seed of its own, and no mean evaluated."""
    return dataclasses.replace(study, trials=trials, common_seeds=False, eval_mean=False)


def again(
    sweep: Sweep,
    winners: Callable[[Summary, Budget], Iterable[Setting]] = lambda summary, _: best_of_each_loss(summary),
    *,
    name: str = "",
    trials: Callable[[Budget], int | None] | None = None,
    env_kwargs: Mapping[str, Any] | None = None,
) -> Sweep:
    """A sweep's winners on fresh seeds, by which they are judged: the mean of the best of many flatters.

    By default each loss's best setting, as often as FRESH_TRIALS has it, with the sweep's constants of the environment.
    """

    def study(budget: Budget, done: Done) -> Study:
        main = done[sweep.name]
        n = trials(budget) if trials else FRESH_TRIALS.get(budget, {}).get(sweep.name)
        settings = tuple(dict.fromkeys(winners(main, budget)))
        return with_constants(on_fresh_seeds(main.study, settings, n), env_kwargs)

    return Sweep(name or f"{sweep.name}-again", study, winners_of=sweep)


def grid(
    name: str,
    task: str,
    settings: Callable[[Budget], Iterable[Setting]],
    *,
    title: str = "",
    trials: Callable[[Budget], int] | None = None,
    env_kwargs: Mapping[str, Any] | None = None,
) -> Sweep:
    """Settings of a task from which the best are chosen, at the main experiment's length."""

    def study(budget: Budget, _: Done) -> Study:
        found = task_study(task, budget, tuple(dict.fromkeys(settings(budget))))
        found = dataclasses.replace(found, trials=trials(budget)) if trials else found
        return with_constants(found, env_kwargs)

    return Sweep(name, study, title)


def with_constants(study: Study, env_kwargs: Mapping[str, Any] | None) -> Study:
    """The same study with these constants of the environment, as files have them; None for its own."""
    return study if env_kwargs is None else dataclasses.replace(study, env_kwargs=json.dumps(dict(env_kwargs)))


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
    if (task, budget) == ("ant", "grid"):  # what Ant can afford: not crossed
        blocks = paper_blocks(rates, [50, 200], [0.05, 0.25, 0.75])
        found, wide = expand([*blocks[:2], blocks[2] | {"n_bins": 100}], base), [2.0]
    elif budget in ("grid", "paper"):
        found = paper_grid(known.env, base)
    else:
        rates, bins = (rates[-3:], bins) if budget == "small" else (rates[1:3], [20])
        if (task, budget) == ("ant", "small"):
            rates = rates[::2]
        wide = [2.0]
        found = expand(paper_blocks(rates, bins, etas if known.in_jax else etas[:1]), base)
    centred = {"loss": "hl-gauss-centred", "learning_rate": rates, "n_bins": bins, "eta": wide}
    return found + expand([centred], base)


_TRIALS: dict[Budget, dict[str, int]] = {
    "paper": dict.fromkeys(TASKS, 20) | {"bandit": 50},
    "grid": dict.fromkeys(TASKS, 5) | {"bandit": 20, "half-cheetah": 2, "ant": 2},
    "small": dict.fromkeys(TASKS, 5) | {"bandit": 20, "ant": 3},
    "smoke": dict.fromkeys(TASKS, 2),
}


def task_study(task: str, budget: Budget, settings: tuple[Setting, ...]) -> Study:
    """These settings on a task, at App. C.2's length but for the smoke test."""
    known, trials = TASKS[task], _TRIALS[budget][task]
    if budget == "smoke":
        return Study(known.env, settings, trials, steps=400, logs=4, eval_episodes=1)
    logs, episodes = (50 if task == "bandit" else known.n_logs), known.n_eval_episodes
    if budget in ("grid", "paper"):
        logs, episodes = _EVALUATED.get(task, (logs, episodes))
    return Study(known.env, settings, trials, known.total_timesteps, logs, episodes)


_EVALUATED = {"reacher": (50, 10), "half-cheetah": (25, 5), "ant": (25, 5)}
"""Log points and episodes at each of them where they cost: of HalfCheetah and Ant an eighth of the steps."""


MAIN = {task: grid(task, task, functools.partial(main_settings, task), title=TASKS[task].title) for task in TASKS}
"""The main sweep of each task: the grid of App. C.2, and centred HL-Gauss."""
AGAIN = {task: again(MAIN[task]) for task in TASKS}
"""The sweep of each task that trains each loss's best setting of the grid on fresh seeds."""
