"""Samples of gradients that nobody measured, with factors that tests choose."""

import pyarrow as pa

from galton.losses import LOSSES
from studies.paper.gradients import READINGS, Sample

SERIES = [("gaussian", "sigma^2"), ("gaussian", "sigma"), *((loss, "") for loss in LOSSES if loss != "gaussian")]
SHARED = 2.0
"""l + ‖f‖ of every sample."""


def sample(advantage, sigma, own_bound, tightness=0.25):
    """One whose own bound and tightness are these."""
    bound = abs(advantage) * SHARED * own_bound
    return Sample(advantage, sigma, own_bound, SHARED / 4, 3 * SHARED / 4, tightness * bound, bound)


def table(samples_of, tasks=("mountain-car", "lqr"), steps=(0, 40), seeds=2):
    """A table as `collect` makes it: `samples_of(task, loss, power of σ, step, factor, seed)` is a list of Samples.

    The Gaussian's policies and HL-Gauss's are made sharper too, after the last step.
    """
    rows = []
    for task in tasks:
        for loss, reading in SERIES:
            sharper = [(True, factor, steps[-1]) for factor in (1.0, 0.01)] if loss in ("gaussian", "hl-gauss") else []
            for swept, factor, step in [*((False, 1.0, step) for step in steps), *sharper]:
                for seed in range(seeds):
                    keys = {"task": task, "loss": loss, "reading": reading, "step": step, "seed": seed}
                    keys |= {"swept": swept, "factor": factor}
                    found = samples_of(task, loss, READINGS.get(reading, 0), step, factor, seed)
                    rows += [keys | {"sample": i} | one._asdict() for i, one in enumerate(found)]
    return pa.Table.from_pylist(rows)


def plain(task, loss, power, step, factor, seed):
    """|a − μ| = σ = 0.5 and Σ|q − π| = 1.5, alike at all steps; at step 40 all advantages are thrice those at 0."""
    del task, loss, seed
    sigma = 0.5 * factor
    own = sigma / sigma**power if power else 1.5
    return [sample(i * (1 + step / 20), sigma, own) for i in (-1, 0, 1)]
