"""Verdicts on what §4.3 says, on samples that were made up, and by other code on those that are published."""

from itertools import pairwise
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from scipy import stats

from galton.losses import LOSSES
from galton.tasks import TASKS
from studies.paper import norms
from studies.paper.norms import LIKELIHOOD, PRINTED
from studies.paper.trained import Trained

from .samples import SHARED, sample, table

PUBLISHED = Path(__file__).parents[2] / "results" / "paper" / "data" / "propositions.parquet"


def trained(samples):
    return Trained({}, {norms.NAME: samples})


def grown(wide, sharp=1.0):
    """One task where the Gaussian's bound is so many times larger in the end, and its norm ∝ 1/σ^sharp."""

    def samples_of(task, loss, power, step, factor, seed):
        growth = wide if step else 1.0
        own = 3.0 * growth if power else growth**0.1
        norm = 0.5 / factor**sharp if power else 0.5
        one = sample(1.0, 0.5 * factor, max(own + 0.01 * seed, norm / SHARED))
        return [one._replace(norm=norm)]

    return trained(table(samples_of, ("lqr",), (0, 100), 6))


@pytest.mark.parametrize("reading", [LIKELIHOOD, PRINTED])
def test_a_larger_or_smaller_gaussian(reading):
    larger, smaller = grown(2.0), grown(0.01)
    for claim in (norms.bound_is_smaller, norms.bound_varies_less):
        assert claim(larger, reading).verdict == "holds"
    assert "the smaller one to the end: LQR HL-1-Hot from step 0" in norms.bound_is_smaller(larger, reading).why
    assert "LQR HL-Gauss at no look" in norms.bound_is_smaller(smaller, reading).why
    assert norms.bound_is_smaller(grown(0.01), reading).verdict == "holds"  # over all of training
    assert norms.norm_is_smaller(larger, reading).verdict == "not decidable here"


def test_the_gaussian_explodes_or_does_not():
    assert norms.bounds_hold(grown(2.0)).verdict == "holds"
    assert norms.bounds_hold(grown(2.0)).number == "0 of 84 above the bound"
    assert norms.sigma_explodes(grown(2.0, sharp=1.0)).verdict == "holds"
    assert norms.sigma_explodes(grown(2.0, sharp=0.0)).verdict == "does not hold"


def column(name):
    """A column of the published samples as numpy has it."""
    return pq.read_table(PUBLISHED, columns=[name]).column(0).to_numpy(zero_copy_only=False)


@pytest.fixture(scope="module")
def published():
    return {name: column(name) for name in pq.read_schema(PUBLISHED).names}


def over_training(of, chosen, values):
    """For each seed the mean over time of a look's mean, each up to half way to its neighbours, and its deviation."""
    found = []
    for seed in sorted(set(of["seed"][chosen])):
        run = chosen & (of["seed"] == seed)
        steps = sorted(set(of["step"][run]))
        looks = np.array([values[run & (of["step"] == step)].mean(dtype=float) for step in steps])
        ends = [steps[0], *((a + b) / 2 for a, b in pairwise(steps)), steps[-1]]
        lengths = [b - a for a, b in pairwise(ends)]
        mean = np.average(looks, weights=lengths)
        found.append((mean, np.average((looks - mean) ** 2, weights=lengths) ** 0.5))
    return np.transpose(found)


def recomputed(of, reading, task, loss):
    """log₁₀ of Gaussian / classification: level, own factor, norm, SD and coefficient of variation, by seed."""
    found = []
    for name, its in (("gaussian", reading), (loss, "")):
        chosen = (of["task"] == task) & (of["loss"] == name) & (of["reading"] == its) & ~of["swept"]
        advantage = np.abs(of["advantage"].astype(float))
        shared = advantage * (of["lipschitz"].astype(float) + of["feature_norm"])
        level, deviation = over_training(of, chosen, of["bound"] / advantage)
        own, _ = over_training(of, chosen, of["bound"] / shared)
        norm, _ = over_training(of, chosen, of["norm"] / advantage)
        found.append(np.log10([level, own, norm, deviation, deviation / level]))
    return found


UNITS = [(task, loss) for task in ("mountain-car", "lqr") for loss in ("hl-one-hot", "hl-gauss")]
LEVEL, OWN, NORM, DEVIATION, VARIATION = range(5)
"""The columns of each row of `recomputed`."""


def numbers(reading, published, row):
    """The difference of each of UNITS as the page writes it."""
    for task, loss in UNITS:
        gaussian, ours = recomputed(published, reading, task, loss)
        low, high = stats.ttest_ind(gaussian, ours, axis=1, equal_var=False).confidence_interval(0.95)
        yield f"{(low[row] + high[row]) / 2:+.2f} ± {(high[row] - low[row]) / 2:.2f}".replace("-", "−")


def ways(reading, published, row):
    """1 where a rank test, adjusted after Holm, says that the Gaussian's of UNITS are larger, −1 smaller, or 0."""
    pairs = [[side[row] for side in recomputed(published, reading, *unit)] for unit in UNITS]
    p = [stats.mannwhitneyu(*pair, method="exact").pvalue for pair in pairs]
    found, rejecting = {}, True
    for rank, i in enumerate(np.argsort(p, kind="stable")):
        rejecting = rejecting and p[i] * (len(p) - rank) < 0.05
        found[i] = int(np.sign(np.median(pairs[i][0]) - np.median(pairs[i][1]))) * rejecting
    return [found[i] for i in range(len(p))]


@pytest.mark.parametrize("reading", [LIKELIHOOD, PRINTED])
def test_the_published_samples_say_so_by_other_code_too(reading, published):
    data = trained(pq.read_table(PUBLISHED))
    level, norm = norms.bound_is_smaller(data, reading), norms.norm_is_smaller(data, reading)
    varies = norms.bound_varies_less(data, reading)
    for row, claim in ((LEVEL, level), (NORM, norm), (DEVIATION, varies)):
        decided, lines = ways(reading, published, row), claim.number.splitlines()
        assert claim.verdict == ("holds" if reading == LIKELIHOOD else "does not hold")
        assert claim.count == (decided.count(1), len(UNITS))
        assert [line[0] for line in lines] == [{1: "✓", -1: "✗", 0: "≈"}[way] for way in decided]
        for (task, loss), number, line in zip(UNITS, numbers(reading, published, row), lines, strict=True):
            assert f"{TASKS[task].title} {LOSSES[loss].label} {number}, " in line
    for row, field in ((OWN, "own_bound"), (VARIATION, "variation")):
        found = norms.against_gaussian(data, reading, field)
        assert [f"{gap.difference:+.2f}" for gap in found.values()] == [*numbers(reading, published, row)]


def test_a_gaussian_with_smaller_gradients_turns_the_verdicts():
    table = pq.read_table(PUBLISHED)
    factor = np.where(np.asarray(table.column("loss")) == "gaussian", np.float32(1e-3), np.float32(1))
    for name in ("norm", "bound"):
        changed = pa.array(np.asarray(table.column(name)) * factor)
        table = table.set_column(table.column_names.index(name), name, changed)
    data = trained(table)
    for claim in (norms.bound_is_smaller, norms.norm_is_smaller, norms.bound_varies_less):
        assert claim(data, LIKELIHOOD).verdict == "does not hold"
