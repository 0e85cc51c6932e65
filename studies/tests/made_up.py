"""Sweeps that nobody trained, with returns that tests choose."""

import dataclasses

import numpy as np
import pyarrow as pa

from galton.tasks import TASKS
from galton_experiments.runs import CURVES, Summary
from studies.paper.registry import all_sweeps
from studies.paper.trained import Trained, rest
from studies.paper.why import METRICS

LOGGED = tuple(dict.fromkeys((*CURVES, *METRICS, "sigma")))
"""The metrics that figures and tables show, and one that they don't."""

PROVENANCE = {
    "budget": "smoke",
    "versions": [{"galton": "0", "jax": "0"}],
    "machines": ["<b>mine</b>"],
    "train_seconds": 60,
    "compile_seconds": 60,
}


def results(study, final_of, n_logs=6, noise=0.01, diverged=(), seed=0, start=-1):
    """A table as `collect` makes it: curves that rise from `start` to what `final_of(setting)` says."""
    rng = np.random.default_rng(seed)
    setting = np.repeat(np.arange(len(study.settings)), study.trials)
    trial = np.tile(np.arange(study.trials), len(study.settings))
    ends = np.array([final_of(study.settings[i]) for i in setting]) + noise * rng.normal(size=len(setting))
    curves = start + (ends[:, None] - start) * np.linspace(0, 1, n_logs) ** 0.5
    diverged_at = np.where(np.isin(np.arange(len(setting)), diverged), 1, -1).astype(np.int32)
    curves[diverged_at >= 0] = np.nan
    lists = {name: pa.FixedSizeListArray.from_arrays(curves.astype(np.float32).ravel(), n_logs) for name in LOGGED}
    final = np.where(diverged_at >= 0, np.nan, ends).astype(np.float32)
    return pa.table(
        {
            "setting": setting.astype(np.int32),
            "trial": trial.astype(np.int32),
            "final_training_return": final,
            "final_evaluation_return": final,
            "diverged_at": diverged_at,
            "steps": pa.FixedSizeListArray.from_arrays(
                np.tile(np.linspace(1, study.steps, n_logs).astype(np.int32), len(setting)),
                type=pa.list_(pa.field("element", pa.int32()), n_logs),
            ),
        }
        | lists
    )


SWEEPS = all_sweeps()


def data(final_of, names=tuple(SWEEPS), budget="smoke", noise=0.01, trials=None, above_rest=False):
    """Sweeps by name; `final_of(name, setting)` is where its runs end, give or take noise.

    With `above_rest` that is so far above what their task earns without learning, where their curves start.
    """
    done = {}
    for name in SWEEPS:
        if name in names:
            study = SWEEPS[name].study(budget, done)
            study = dataclasses.replace(study, trials=trials or study.trials)
            low = rest(task_named(study.env)) if above_rest else 0

            def ends(setting, name=name, low=low):
                return low + final_of(name, setting)

            table = results(study, ends, noise=noise, start=low - 1)
            done[name] = Summary.of_results(study, table, PROVENANCE)
    return Trained(done)


def task_named(env):
    """The name in TASKS of the task on an environment."""
    return next(name for name, task in TASKS.items() if task.env == env)


def judgeable(final_of, names=tuple(SWEEPS), budget="smoke", noise=0.01, trials=12):
    """The same, above rest and with as many trials as it takes to decide something."""
    return data(final_of, names, budget, noise, trials, above_rest=True)
