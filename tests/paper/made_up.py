"""Sweeps that nobody trained, with returns that tests choose."""

import numpy as np
import pyarrow as pa

from galton.paper.registry import all_sweeps
from galton.paper.summary import CURVES, Summary
from galton.paper.trained import Trained
from galton.paper.why import METRICS

LOGGED = tuple(dict.fromkeys((*CURVES, *METRICS, "sigma")))
"""What figures and tables show, and a metric that they don't."""

PROVENANCE = {
    "budget": "smoke",
    "versions": [{"galton": "0", "jax": "0"}],
    "machines": ["<b>mine</b>"],
    "train_seconds": 60,
    "compile_seconds": 60,
}


def results(study, final_of, n_logs=6, noise=0.01, diverged=(), seed=0):
    """A table as `collect` makes it: curves that rise from −1 to what `final_of(setting)` says."""
    rng = np.random.default_rng(seed)
    setting = np.repeat(np.arange(len(study.settings)), study.trials)
    trial = np.tile(np.arange(study.trials), len(study.settings))
    ends = np.array([final_of(study.settings[i]) for i in setting]) + noise * rng.normal(size=len(setting))
    curves = -1 + (ends[:, None] + 1) * np.linspace(0, 1, n_logs) ** 0.5
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


def data(final_of, names=tuple(SWEEPS), budget="smoke", noise=0.01):
    """Sweeps by name; `final_of(name, setting)` is where its runs end, give or take noise."""
    done = {}
    for name in SWEEPS:
        if name in names:
            study = SWEEPS[name].study(budget, done)
            table = results(study, lambda setting, name=name: final_of(name, setting), noise=noise)
            done[name] = Summary.of_results(study, table, PROVENANCE)
    return Trained(done)
