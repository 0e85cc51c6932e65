"""The second path, part 1: the runs of a folder of results, read with pyarrow and numpy alone.

Nothing of galton is imported in the modules of this folder: what they find is compared with what the page says.
"""

import functools
import json
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pyarrow.parquet as pq
from scipy.linalg import solveh_banded

DATA = Path(__file__).parents[3] / "results" / "paper" / "data"
CURVES = ("training_return", "evaluation_return", "mean_action_return")
PAPER = ("gaussian", "hl-one-hot", "hl-gauss")
CLASSIFIED = PAPER[1:]
LABELS = dict(
    zip((*PAPER, "hl-gauss-centred"), ("Gaussian", "HL-1-Hot", "HL-Gauss", "Centred HL-Gauss (ours)"), strict=True)
)
TITLES = {
    "bandit": "Bandit",
    "lqr": "LQR",
    "mountain-car": "Mountain Car",
    "acrobot": "Acrobot",
    "reacher": "Reacher",
    "half-cheetah": "HalfCheetah",
    "ant": "Ant",
}
STILL = {"mountain-car": 0.0, "acrobot": -500.0, "reacher": -11.69, "half-cheetah": -0.23, "ant": 994.2}
"""The return of the action 0, by simulation (docs/paper.md); by arithmetic on the bandit and the LQR."""


class Runs(NamedTuple):
    """The trials of one setting in one sweep."""

    setting: dict
    finals: dict
    """By metric, [trials]; NaN where a run diverged."""
    curves: dict
    """By metric, [trials, log points]; a point without an episode is the one before, NaN before the first."""
    steps: np.ndarray
    seed: int | None
    """The seed that trial t has in common with other runs; None where each run has its own."""

    def only(self, n):
        """The first n trials."""
        finals, curves = ({name: of[:n] for name, of in each.items()} for each in (self.finals, self.curves))
        return self._replace(finals=finals, curves=curves)


class Sweep(NamedTuple):
    """Settings that were trained together, or that a change puts beside one another."""

    runs: list
    constants: dict
    """The constants of the environment."""

    def of(self, loss):
        """The setting of a loss with the highest mean final training return; one of which a run diverged is last."""
        return max((runs for runs in self.runs if runs.setting["loss"] == loss), key=mean_final)

    @property
    def losses(self):
        return list(dict.fromkeys(runs.setting["loss"] for runs in self.runs))

    def has(self, metric):
        return all(metric in runs.curves for runs in self.runs)

    @property
    def trials(self):
        return len(self.runs[0].finals["training_return"])

    def worst(self, metric):
        """The worst that any run of the paper's losses did, which is what a run that diverged is taken to earn."""
        return min(float(np.nanmin(runs.curves[metric])) for runs in self.runs if runs.setting["loss"] in PAPER)

    def filled(self, values, metric):
        """The values, with the worst for what a run that diverged has not."""
        return np.where(np.isnan(values), self.worst(metric), values) if np.isnan(values).any() else values

    def final(self, loss, metric="training_return"):
        """The final returns of a loss's best setting."""
        return self.filled(self.of(loss).finals[metric], metric)

    def curve(self, loss, metric="training_return"):
        return self.filled(begun(self.of(loss).curves[metric]), metric)

    def mean(self, loss, metric="training_return"):
        """The mean return over training, by trial."""
        return self.curve(loss, metric).mean(1)


class Task(NamedTuple):
    """The runs that chose settings, and those of the winners on fresh seeds."""

    name: str
    grid: Sweep
    again: Sweep


def mean_final(runs, kind="training_return"):
    finals = runs.finals[kind]
    return -np.inf if np.isnan(finals).any() else float(finals.mean())


def begun(curves):
    """Each row with its first known value in the place of what it lacks before that."""
    rows = []
    for row in curves:
        known = np.flatnonzero(~np.isnan(row))
        rows.append(np.concatenate([np.full(known[0], row[known[0]]), row[known[0] :]]) if len(known) else row)
    return np.array(rows)


def forward(curves):
    """Each NaN is the value before it."""
    found = curves.copy()
    for i in range(1, found.shape[1]):
        found[:, i] = np.where(np.isnan(found[:, i]), found[:, i - 1], found[:, i])
    return found


def matrix(table, name):
    """A column of lists of one length."""
    column = table.column(name).combine_chunks()
    return column.flatten().to_numpy().reshape(len(column), -1)


def settings_of(record):
    """The settings of a study's record, each as all its fields."""
    same, different = record["settings"]["same"], record["settings"]["different"]
    n = len(next(iter(different.values()))) if different else 1
    return [same | {name: values[i] for name, values in different.items()} for i in range(n)]


def record_of(table):
    """The study that a table's metadata describe."""
    return json.loads(table.schema.metadata[b"galton"])["study"]


def sweep_of(table):
    """The sweep that a file's table holds."""
    record = record_of(table)
    known = [name for name in CURVES if name in table.column_names]
    number, gone = (table.column(name).to_numpy() for name in ("setting", "diverged_at"))
    steps = matrix(table, "steps")
    lost = (gone[:, None] >= 0) & (steps >= gone[:, None])
    curves = {name: np.where(lost, np.nan, forward(matrix(table, name).astype(float))) for name in known}
    finals = {name: table.column(f"final_{name}").to_numpy().astype(float) for name in (*known, "entropy")}
    constants = record["constants"]
    seed = constants["seed"] if constants.get("common_seeds") else None
    found = []
    for i, setting in enumerate(settings_of(record)):
        rows = np.flatnonzero(number == i)
        rows = rows[np.argsort(table.column("trial").to_numpy()[rows])]
        own, curve = ({name: of[rows] for name, of in each.items()} for each in (finals, curves))
        found.append(Runs(setting, own, curve, steps[rows[0]], seed))
    return Sweep(found, json.loads(constants["env_kwargs"]))


def tables_in(folder=DATA):
    """The tables of a folder's sweeps, by the name of the file."""
    names = {path.stem: path for path in sorted(folder.glob("*.parquet")) if path.stem != "propositions"}
    assert names, f"no file in {folder}"
    return {name: pq.ParquetFile(path).read(use_threads=False) for name, path in names.items()}


def read_all(folder=DATA):
    """Every sweep of a folder, by the name of its file."""
    return {name: sweep_of(table) for name, table in tables_in(folder).items()}


def tasks_of(sweeps, prefix=""):
    """The main experiment's tasks of which both are done."""
    names = [name for name in TITLES if {prefix + name, f"{prefix}{name}-again"} <= {*sweeps}]
    return {name: Task(name, sweeps[prefix + name], sweeps[f"{prefix}{name}-again"]) for name in names}


def grids_of(sweeps):
    """The grids that hold the whole of App. C.2's, or where none does, all."""
    known = {name: sweeps[name] for name in TITLES if name in sweeps}
    return {name: grid for name, grid in known.items() if is_whole(name, grid)} or known


def is_whole(name, grid):
    """Say whether a grid has 4 learning rates, 3 k and 6 η, or the bandit's 5, crossed."""
    rates = (0.01, 0.05, 0.1, 1.0) if name == "bandit" else (1e-4, 3e-4, 7e-4, 1e-3)
    etas = (0.1, 0.25, 0.5, 0.75, 1.0) if name == "bandit" else (0.01, 0.05, 0.1, 0.25, 0.5, 0.75)
    bins = (50, 100, 200)
    wanted = {("gaussian", rate) for rate in rates} | {("hl-one-hot", rate, k) for rate in rates for k in bins}
    wanted |= {("hl-gauss", rate, k, eta) for rate in rates for k in bins for eta in etas}
    fields = ("loss", "learning_rate", "n_bins", "eta")
    there = {tuple(runs.setting[field] for field in fields) for runs in grid.runs}
    return wanted <= {point[:n] for point in there for n in (2, 3, 4)}


def ends_of(task):
    """Rest and the best: (rest, best), or None where one of both is not known or nothing is better than rest."""
    rest, best = levels_of(task.name, json.dumps(task.grid.constants))
    kinds = ("training_return", "evaluation_return")
    best = max(mean_final(runs, kind) for runs in task.grid.runs for kind in kinds) if best is None else best
    return (rest, best) if rest < best < np.inf else None


@functools.cache
def levels_of(name, constants):
    """Return what is earned without learning, and the optimum or None."""
    if name == "bandit":
        return 0.0, 25.0  # the actions 0: 25 − 5²; uniform ones: 25 − (5² + 20²/12)
    if name == "lqr":
        return lqr(json.loads(constants))
    return STILL[name], None


def lqr(given):
    """Rest and optimum of an LQR, by one least-squares problem for each horizon instead of Riccati's recursion.

    Its A is ρ times a rotation, and Q, R and B are multiples of I: seen from axes that turn along, it is twice the
    scalar problem x' = ρ x + 0.1 u + noise, at a cost of x² + r u².
    """
    turn = 0.98 * np.array([[np.cos(0.1), -np.sin(0.1)], [np.sin(0.1), np.cos(0.1)]])
    a, (r, _) = np.array(given.get("A", turn)), np.diag(given.get("R", np.eye(2)))
    length, variance = given.get("max_episode_steps", 100), 0.05**2
    np.testing.assert_allclose(a.T @ a, a[0] @ a[0] * np.eye(2), atol=1e-12)
    rho = (a[0] @ a[0]) ** 0.5
    powers = rho ** np.arange(length)

    def without_control(spread):
        """E −Σ cost under actions of mean 0 and this variance: each disturbance costs what its powers of ρ make."""
        kicks = sum((powers[: length - 1 - t] ** 2).sum() for t in range(length - 1))
        return -2 * ((powers**2).sum() / 3 + (variance + 0.01 * spread) * kicks + length * r * spread)

    costs = [cost_to_go(n, rho, r) for n in range(1, length + 1)]
    return max(map(without_control, (0.0, 1 / 3))), -2 * (costs[-1] / 3 + variance * sum(costs[:-1]))


def cost_to_go(n, rho, r):
    """The least Σ x² + r u² from x = 1 in n steps: of states x₁ to xₙ, each action being (x' − ρ x) / 0.1."""
    if n == 1:
        return 1.0
    of_action = r / 0.01
    bands = np.full((2, n), -of_action * rho)
    bands[1] = 1 + of_action * (1 + rho**2)
    bands[1, -1] = of_action  # the state after the last step costs nothing
    first = solveh_banded(bands, of_action * rho * np.eye(n)[0])[0]
    return 1 + of_action * rho * (rho - float(first))


def null_of(task):
    """Return the page's words for a task on which fewer than 1% of the runs ever earn more than rest; "" for others."""
    rest, _ = levels_of(task.name, json.dumps(task.grid.constants))
    learners = [(runs.curves["training_return"] > rest).any(1) for runs in task.grid.runs]
    n, of = int(np.concatenate(learners).sum()), sum(map(len, learners))
    is_null = n < 0.01 * of or ends_of(task) is None
    return f"null: {n:,} of {of:,} runs ever earn more than rest" if is_null else ""
