"""Runs of a benchmark that were never trained."""

import numpy as np
import pyarrow as pa

from galton_experiments.benchmark import stages
from galton_experiments.benchmark.draws import draws
from galton_experiments.benchmark.runs import Runs
from galton_experiments.benchmark.selection import Selected

from .files import protocol

NAN = np.nan
KNOWN = protocol(budget__fresh_seeds=8)
METHODS = ("gaussian", "bins", "ppo")


def made_up(stage="fresh", better=0.5, known=KNOWN):
    """Runs of one stage that were never trained, and what each is judged by, by task, method and role.

    Each method is so much better than the one before it, in standard deviations of a method's runs.
    """
    drawn, n = draws(known), known.budget.fresh_seeds
    other = dict.fromkeys(METHODS, 1) | {"bins": 0}
    selected = Selected(dict.fromkeys(METHODS, 0), {"bandit": other, "noisy": other})
    parts = [part for part in stages.afterwards(known, drawn, selected) if part.stage == stage]
    rng, runs, finals = np.random.default_rng(5), [], {}
    for i, part in enumerate(parts):
        of_task = finals.setdefault(part.task.name, {})
        for entry in part.entries:
            found = 10.0**i * rng.normal(better * METHODS.index(entry.method), 1, n)
            alike = entry[:2] == ("bins", "per-task")
            of_task[entry[:2]] = of_task["bins", "shared"] if alike else found.astype(np.float32).astype(float)
        of_task["ppo", "shared"][0] = NAN
        judged = np.concatenate([*of_task.values()])
        diverged_at = np.where(np.isnan(judged), 50, -1)
        table = pa.table({"final_judged": judged, "final_training": -judged, "diverged_at": diverged_at})
        runs.append(Runs(part, table))
    return runs, finals
