"""Hypothesis (b): the same task in other units of the action, for policies that know of units and those that don't."""

import dataclasses
import json

from galton.paper.summary import Summary
from galton.paper.sweeps import AGAIN, MAIN, Budget, Done, Sweep, on_fresh_seeds
from galton.sweep.study import Setting, Study
from galton.tasks import TASKS

SCALE_TASKS = ("bandit", "lqr", "reacher", "half-cheetah")
SCALES = (0.125, 0.5, 1.0, 2.0, 8.0)
"""What the action box is multiplied by: powers of two, by which floating point changes no digit."""
IN_THE_BOX = "gaussian in units of the box"
"""What the Gaussian is called whose mean and σ are in half-widths of the action box."""


def name_of(setting: Setting) -> str:
    """The loss, or IN_THE_BOX for the Gaussian in those units."""
    return IN_THE_BOX if setting.hypers.box_units else setting.config.loss


def in_the_box(setting: Setting) -> Setting:
    """The same setting in units of the box."""
    return setting._replace(hypers=setting.hypers._replace(box_units=1.0))


def _settings(main: Summary, budget: Budget) -> tuple[Setting, ...]:
    """Each loss's best setting of the main experiment, and the Gaussian's in units of the box."""
    losses = ("gaussian", "hl-gauss") if budget == "smoke" else tuple(main.best)
    found = [main.best[loss].setting for loss in losses]
    return (*found, *(in_the_box(setting) for setting in found if setting.config.loss == "gaussian"))


def _sweep(task: str, scale: float) -> Sweep:
    def study(budget: Budget, done: Done) -> Study:
        main = done[task]
        trials = 2 if budget == "smoke" else 10 if TASKS[task].in_jax else 5
        kwargs = json.dumps({"action_scale": scale} if scale != 1 else {})
        found = on_fresh_seeds(main.study, _settings(main, budget), trials)
        return dataclasses.replace(found, env_kwargs=kwargs)

    return Sweep(f"scale-{task}-{scale:g}", study, winners_of=MAIN[task])


SWEEPS = {
    (task, scale): _sweep(task, scale) for task in SCALE_TASKS for scale in SCALES if scale != 1 or task == "bandit"
}
"""The sweeps by task and scale. Scale 1 is the main experiment on fresh seeds; where the box is not [−1, 1], the
Gaussian in its units is trained there too."""


def at_scale_one(task: str) -> tuple[Sweep, ...]:
    """The sweeps that have the task's own units."""
    return (AGAIN[task], SWEEPS[task, 1.0]) if (task, 1.0) in SWEEPS else (AGAIN[task],)
