"""What is trained for the figures: the tasks, and each sweep at three budgets."""

import dataclasses
import json
from collections.abc import Callable, Mapping
from typing import Any, Literal, NamedTuple

from galton.errors import UsageError
from galton.studies.summary import Summary
from galton.sweep.grid import expand, paper_blocks, paper_grid, task_defaults
from galton.sweep.results import mean_returns, rerun
from galton.sweep.study import Setting, Study
from galton.tasks import TASKS

Budget = Literal["smoke", "small", "paper"]
Done = Mapping[str, Summary]
"""The sweeps that are done, by name."""
_FRESH = 1
"""Seed of the studies that judge what others, of seed 0, have chosen."""


NOISES = (0.0, 2.0, 5.0, 10.0)
"""Reward noise of Figure 3a, beside the bandit's own 1; the paper doesn't tell its values."""
DIMENSIONS = (1, 4, 8, 16)
"""Action dimensions of Figure 3b, beside the bandit's own 2."""
CONTROLS = {"bandit-init-gaussian": "Init Gaussian", "bandit-gaussian-exploration": "Gaussian Exploration"}
"""§5.2.3's two conditions."""
CENTRED_ETAS = [0.75, 1.0, 2.0, 4.0]
"""Of centred HL-Gauss, which the paper does not have: η wider than its grid."""


CHANGES: dict[str, dict[str, Any]] = {
    "as in the paper": {},
    "λ = 0.95": {"gae_lambda": 0.95},
    "entropy bonus 0.01": {"ent_coef": 0.01},
    "λ = 0.95 and entropy bonus": {"gae_lambda": 0.95, "ent_coef": 0.01},
    "advantages normalised": {"normalize_advantage": True},
    "observations normalised": {"normalize_observation": True},
    "rewards normalised": {"normalize_reward": True},
    "batch of 4 × 5": {"n_envs": 4, "n_steps": 5},
    "batch of 8 × 20": {"n_envs": 8, "n_steps": 20},
    "all of these, batch of 8 × 20": {
        "gae_lambda": 0.95,
        "ent_coef": 0.01,
        "normalize_advantage": True,
        "normalize_observation": True,
        "normalize_reward": True,
        "n_envs": 8,
        "n_steps": 20,
    },
}
"""What the study of causes changes, one thing at a time and then together."""
WHY_TASKS = ("lqr", "mountain-car", "acrobot")
WHY_RATES = [3e-4, 1e-3, 3e-3]
"""Learning rates there; the last is beyond the paper's grid."""


class Sweep(NamedTuple):
    """One folder of runs."""

    task: str
    """The key in TASKS."""
    about: str
    study: Callable[[Budget, Done], Study]
    needs: tuple[str, ...] = ()
    """The sweeps whose winners it trains."""


def _settings(task: str, budget: Budget) -> tuple[Setting, ...]:
    """The grid of a task's main sweep: the paper's, centred HL-Gauss beside it, or a part of both."""
    known, base = TASKS[task], task_defaults(TASKS[task].env)
    if budget == "paper":
        centred = {
            "loss": "hl-gauss-centred",
            "learning_rate": known.learning_rates,
            "n_bins": 100,
            "eta": CENTRED_ETAS,
        }
        return paper_grid(known.env, base) + expand([centred], base)
    rates, bins = (known.learning_rates[-3:], [100]) if budget == "small" else (known.learning_rates[1:3], [20])
    if (task, budget) == ("ant", "small"):
        rates = rates[::2]
    centred = {"loss": "hl-gauss-centred", "learning_rate": rates, "n_bins": bins, "eta": 2.0}
    return expand([*paper_blocks(rates, bins, [0.25, 0.75] if known.in_jax else [0.25]), centred], base)


_TRIALS: dict[Budget, dict[str, int]] = {
    "paper": dict.fromkeys(TASKS, 20) | {"bandit": 50},
    "small": dict.fromkeys(TASKS, 5) | {"bandit": 20, "ant": 3},
    "smoke": dict.fromkeys(TASKS, 2),
}


def _study(task: str, budget: Budget, settings: tuple[Setting, ...]) -> Study:
    """App. C.2's lengths, but for the smoke test."""
    known, trials = TASKS[task], _TRIALS[budget][task]
    if budget == "smoke":
        return Study(known.env, settings, trials, steps=400, logs=4, eval_episodes=1)
    logs = 50 if task == "bandit" else known.n_logs
    return Study(known.env, settings, trials, known.total_timesteps, logs, known.n_eval_episodes)


def _main(task: str) -> Sweep:
    about = f"{TASKS[task].title}: the grid of App. C.2, and centred HL-Gauss"
    return Sweep(task, about, lambda budget, _: _study(task, budget, _settings(task, budget)))


def _again(name: str, task: str, about: str) -> Sweep:
    """A sweep's winners on fresh seeds: the mean of the best of many flatters."""

    def study(_: Budget, done: Done) -> Study:
        main = done[name]
        return rerun(main.study, main.best, main.study.trials, _FRESH)

    return Sweep(task, f"{about}: each loss's best setting on fresh seeds", study, (name,))


def _bandit_control(name: str, field: str) -> Sweep:
    """The bandit's sweep again, with the softmax policies under one of §5.2.3's two conditions."""

    def study(budget: Budget, _: Done) -> Study:
        change: dict[str, Any] = {field: "gaussian"}
        changed = tuple(
            setting._replace(config=dataclasses.replace(setting.config, **change))
            for setting in _settings("bandit", budget)
            if setting.config.loss != "gaussian"
        )
        return _study("bandit", budget, changed)

    return Sweep("bandit", f"Bandit: the classification losses with {CONTROLS[name]}", study)


def _bandit_with(constant: str, value: float | int) -> Sweep:
    """The bandit's winners on another bandit, on fresh seeds."""

    def study(budget: Budget, done: Done) -> Study:
        main = done["bandit"]
        losses = ("gaussian", "hl-gauss") if budget == "smoke" else tuple(main.best)
        settings = tuple(main.best[loss].setting for loss in losses)
        kwargs = json.dumps({constant: value})
        return dataclasses.replace(main.study, settings=settings, env_kwargs=kwargs, seed=_FRESH)

    return Sweep("bandit", f"Bandit: each loss's best setting, {constant} = {value}", study, ("bandit",))


def _why(task: str) -> Sweep:
    """All losses with each of CHANGES."""

    def study(budget: Budget, _: Done) -> Study:
        smoke = budget == "smoke"
        rates, bins = ([1e-3], 20) if smoke else (WHY_RATES, 100)
        names = ["as in the paper", "λ = 0.95"] if smoke else list(CHANGES)
        losses: list[dict[str, Any]] = [
            {"loss": ["gaussian", "hl-one-hot"]},
            {"loss": "hl-gauss", "eta": 0.25},
            {"loss": "hl-gauss-centred", "eta": [2.0] if smoke else [2.0, 4.0]},
        ]
        blocks = [{"learning_rate": rates, "n_bins": bins} | loss | CHANGES[name] for name in names for loss in losses]
        settings = expand(blocks, task_defaults(TASKS[task].env))
        main = _study(task, budget, settings[:1])
        trials = {"smoke": 2, "small": 3, "paper": 5}[budget]
        logs = main.logs if smoke else 125  # for batches of 20 and 160
        return dataclasses.replace(main, settings=settings, trials=trials, logs=logs)

    return Sweep(task, f"{TASKS[task].title}: what changes the order of the losses", study)


def _why_again(task: str) -> Sweep:
    """The winners of that, one for each change and loss, on fresh seeds."""

    def study(_: Budget, done: Done) -> Study:
        main = done[f"why-{task}"]
        return dataclasses.replace(main.study, settings=best_of_each(main), seed=_FRESH)

    about = f"{TASKS[task].title}: each loss's best setting under each change on fresh seeds"
    return Sweep(task, about, study, (f"why-{task}",))


def best_of_each(summary: Summary) -> tuple[Setting, ...]:
    """Of settings alike but for learning rate and η the one with the highest mean final training return.

    One with a run that diverged loses to any other.
    """
    means = mean_returns(summary.study, summary.table)
    found: dict[Setting, Setting] = {}
    for setting, mean in means.items():
        alike = setting._replace(hypers=setting.hypers._replace(learning_rate=0.0, eta=0.0))
        if alike not in found or mean > means[found[alike]]:
            found[alike] = setting
    return tuple(found.values())


SWEEPS: dict[str, Sweep] = (
    {task: _main(task) for task in TASKS}
    | {f"{task}-again": _again(task, task, TASKS[task].title) for task in TASKS}
    | {f"bandit-noise-{noise:g}": _bandit_with("noise_std", noise) for noise in NOISES}
    | {f"bandit-d-{d}": _bandit_with("d", d) for d in DIMENSIONS}
    | {
        "bandit-init-gaussian": _bandit_control("bandit-init-gaussian", "initial_policy"),
        "bandit-gaussian-exploration": _bandit_control("bandit-gaussian-exploration", "exploration"),
    }
    | {f"{name}-again": _again(name, "bandit", f"Bandit, {label}") for name, label in CONTROLS.items()}
    | {f"why-{task}": _why(task) for task in WHY_TASKS}
    | {f"why-{task}-again": _why_again(task) for task in WHY_TASKS}
)


def find_sweep(name: str) -> Sweep:
    """The entry of that name; UsageError lists the names if there is none."""
    if name not in SWEEPS:
        raise UsageError(f"sweep is {name!r}; choose from {', '.join(SWEEPS)}")
    return SWEEPS[name]
