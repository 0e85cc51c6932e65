"""Claims on the committed results once more from the Parquet files, with pyarrow, numpy and scipy alone."""

import json
import re
from pathlib import Path

import numpy as np
import pyarrow.parquet as pq
import pytest
from scipy import stats

from galton.paper import reproduce, returns, stability
from galton.paper.standings import clear

PAPER = Path(__file__).parents[2] / "results" / "paper"
# What is earned without learning: by simulation, or for the bandit 25 − 5². And the optima, by arithmetic and Riccati.
REST = {"Bandit": 0.0, "LQR": -26.03, "Acrobot": -500.0, "Reacher": -11.69, "HalfCheetah": -0.23, "Ant": 994.2}
OPTIMA = {"Bandit": 25.0, "LQR": -9.7719}
PAIRS = 8
CLASSIFIED = ("hl-one-hot", "hl-gauss")


class Sweep:
    """A file's runs by loss; of a grid, by the setting of each with the highest mean final training return."""

    def __init__(self, title):
        table = pq.ParquetFile(PAPER / "data" / f"{title}.parquet").read(use_threads=False)
        study = json.loads(table.schema.metadata[b"galton"])["study"]
        self.table, self.paired = table, study["constants"].get("common_seeds", False)
        losses = (study["settings"]["different"] | study["settings"]["same"])["loss"]
        setting, finals = (table.column(name).to_numpy() for name in ("setting", "final_training_return"))
        means = {i: finals[setting == i].astype(float).mean() for i in np.unique(setting)}
        self.best_mean = max(means.values())
        self.rows = {}
        for loss in dict.fromkeys(losses):
            own = [i for i in means if losses[i] == loss]
            self.rows[loss] = setting == max(own, key=means.get)

    def final(self, loss, metric="training_return"):
        return self.table.column(f"final_{metric}").to_numpy()[self.rows[loss]].astype(float)

    def curves(self, loss, metric="training_return"):
        """NaN, where no episode ended, is what was before it."""
        found = np.array(self.table.column(metric).to_pylist(), float)[self.rows[loss]]
        for i in range(1, found.shape[1]):
            found[:, i] = np.where(np.isnan(found[:, i]), found[:, i - 1], found[:, i])
        return found

    @property
    def steps(self):
        return np.array(self.table.column("steps")[0].as_py())


TASKS = {
    "Bandit": "bandit",
    "LQR": "lqr",
    "Acrobot": "acrobot",
    "Reacher": "reacher",
    "HalfCheetah": "half-cheetah",
    "Ant": "ant",
}


@pytest.fixture(scope="module")
def sweeps():
    return {title: (Sweep(name), Sweep(f"{name}-again")) for title, name in TASKS.items()}


@pytest.fixture(scope="module")
def trained():
    return reproduce.load(str(PAPER))


def p_of(a, b, paired):
    if paired and len(a) >= PAIRS:
        return stats.wilcoxon(a, b, method="exact" if len(a) <= 50 and (a != b).all() else "auto").pvalue
    ties = len({*a, *b}) < len(a) + len(b)
    return stats.mannwhitneyu(a, b, method="asymptotic" if ties or len(a) > 25 else "exact").pvalue


def judge(samples, paired):
    """The mark of each task, from what the paper says is above and what it says is below."""
    p, sign = {}, {}
    for title, (a, b) in samples.items():
        above = np.mean([(x > y) + 0.5 * (x == y) for x in a for y in b]) - 0.5
        sign[title] = np.sign(above) if np.sign(above) == np.sign(a.mean() - b.mean()) else 0
        if stats.mannwhitneyu(np.arange(len(a)), len(a) + np.arange(len(b)), method="exact").pvalue < 0.05:
            p[title] = p_of(a, b, paired[title])
    marks, adjusted = dict.fromkeys(samples, "?"), 0.0
    for i, title in enumerate(sorted(p, key=p.get)):
        adjusted = max(adjusted, (len(p) - i) * p[title])
        marks[title] = {1: "✓", -1: "✗"}.get(sign[title], "≈") if adjusted < 0.05 else "≈"
    return marks


def judged(sweeps, titles, better_by, pair, pairs=True):
    """The marks of some tasks, by the classification loss that is better on the grid, and its pair of samples."""
    samples = {}
    for title in titles:
        grid, again = sweeps[title]
        loss = max(CLASSIFIED, key=lambda loss: better_by(grid, loss).mean())
        samples[title] = pair(title, again, loss)
    return judge(samples, {title: pairs and sweeps[title][1].paired for title in titles})


def shown(claim):
    """The marks of a claim's lines, but for null tasks."""
    lines = claim.number.splitlines()
    return {re.match(r"\w+", line[2:])[0]: line[0] for line in lines if line[0] != "∅"}


def over_training(sweep, loss):
    return sweep.curves(loss).mean(1)


ALL_BUT_ACROBOT = [title for title in TASKS if title != "Acrobot"]


def test_who_ends_higher_and_who_has_more_over_training(sweeps, trained):
    ends = judged(sweeps, ALL_BUT_ACROBOT, Sweep.final, lambda _, s, loss: (s.final(loss), s.final("gaussian")))
    assert shown(returns.ends_higher(trained)) == ends
    means = judged(
        sweeps, ALL_BUT_ACROBOT, over_training, lambda _, s, x: (over_training(s, x), over_training(s, "gaussian"))
    )
    assert shown(returns.learns_faster(trained)) == means


def test_who_is_sooner_a_quarter_of_the_way(sweeps, trained):
    def steps(title, again, loss):
        rest, best = REST[title], OPTIMA.get(title, sweeps[title][0].best_mean)
        there = again.curves(loss) >= rest + 0.25 * (best - rest)
        return np.where(there.any(1), again.steps[there.argmax(1)], 2.0 * again.steps[-1])

    found = judged(
        sweeps, ALL_BUT_ACROBOT, over_training, lambda *of: (steps(*of[:2], "gaussian"), steps(*of)), pairs=False
    )
    assert shown(returns.learns_sooner(trained)) == found


def test_who_is_more_stable(sweeps, trained):
    def apart(again, loss):
        finals = again.final(loss)
        return abs(finals - np.median(finals))

    def lost(again, loss):
        return again.curves(loss).max(1) - again.final(loss)

    for claim, score in ((stability.alike_between_seeds, apart), (stability.keeps_what_it_learns, lost)):
        found = judged(sweeps, TASKS, Sweep.final, lambda _, s, x, score=score: (score(s, "gaussian"), score(s, x)))
        assert shown(claim(trained)) == found


def test_which_losses_are_clearly_ahead_of_the_gaussian(sweeps, trained):
    samples, paired = {}, {}
    for title, (_, again) in sweeps.items():
        for loss in (*CLASSIFIED, "hl-gauss-centred"):
            samples[TASKS[title], loss] = again.final(loss), again.final("gaussian")
            paired[TASKS[title], loss] = again.paired
    assert clear(trained) == judge(samples, paired)


def test_the_null_task_is_one():
    """Fewer than one run in a hundred of Mountain Car's grid ever has a mean return above that of doing nothing."""
    curves = np.array(Sweep("mountain-car").table.column("training_return").to_pylist(), float)
    assert (curves > 0).any(1).mean() < 0.01
