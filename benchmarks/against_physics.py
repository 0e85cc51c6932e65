"""Training on MuJoCo against the bare physics and against Stable-Baselines3, all sides in one run.

Populations: 64 runs of HL-Gauss at k = 100, 20 steps an update, in a process per core as a sweep trains them, beside
`mujoco.batch` stepping 64 simulations with random actions on as many threads (for Ant, whose contact forces it does
not compute, a loop over MjData in threads), with and without the clock of MuJoCo's profiler, and beside one SB3
process per core with A2C on MultiDiscrete. One run: HalfCheetah-v5 through plain Gymnasium. SB3 takes one torch
thread, which is its faster setting. Each side lives in processes of its own; sides take turns; medians over the
rounds. Nothing else should be running.

    python benchmarks/against_physics.py [--rounds 3] [--out results/benchmarks]
"""

import argparse
import contextlib
import statistics
from pathlib import Path

import numpy as np
from rich.console import Console
from rich.table import Table
from sides import SB3, K, Ours, Side, write

import galton
from galton.devices import n_cores
from galton.envs.host import simulation
from galton_experiments.sweep.executors import Place, one_per_core

RUNS = 64
TASKS = ("Reacher-v5", "HalfCheetah-v5", "Ant-v5")


class Physics:
    """The simulations alone."""

    def __init__(self, task):
        self.envs = galton.envs.find(task).make(RUNS, n_cores())
        self.envs.reset(np.arange(RUNS))
        self.control = np.random.default_rng(0).uniform(-1, 1, (50, RUNS, self.envs._actions.low.size))

    def advance(self):
        for control in self.control:
            self.envs._simulations.step(control, self.envs._constants.frame_skip)
        return len(self.control) * RUNS


class Profiled(Physics):
    """The simulations as MuJoCo's Python package has them, with the clock of its profiler."""

    def __init__(self, task):
        simulation.unprofiled = contextlib.nullcontext
        super().__init__(task)


def main():
    parser = argparse.ArgumentParser()
    parser.add_argument("--rounds", type=int, default=3)
    parser.add_argument("--out", type=Path, default=Path("results/benchmarks"))
    arguments = parser.parse_args()
    cores, free = one_per_core(), [Place()]
    sides = {}
    for task in TASKS:
        sides[task, "physics"] = Side(free, Physics, task)
        sides[task, "profiled"] = Side(free, Profiled, task)
        sides[task, "galton"] = Side(cores, Ours, task, False, "hl-gauss", K, RUNS // len(cores), 10)
        sides[task, "sb3"] = Side(cores, SB3, task, True, 1_500)
    for discrete in (False, True):
        sides["one", "sb3", discrete] = Side(free, SB3, "HalfCheetah-v5", discrete, 1_500)
    for loss in ("gaussian", "hl-one-hot", "hl-gauss"):
        sides["one", loss] = Side(free, Ours, "HalfCheetah-v5", True, loss, K, 1, 200)
    speeds = {key: [] for key in sides}
    for _ in range(arguments.rounds):
        for key, side in sides.items():
            speeds[key].append(side.steps_per_second())
    for side in sides.values():
        side.close()
    median = {key: statistics.median(values) for key, values in speeds.items()}

    table = Table(title=f"{RUNS} runs, HL-Gauss, k = {K}; {n_cores()} cores, median of {arguments.rounds} rounds")
    headings = ("task", "physics, profiled", "physics alone", "training", "share of physics", "SB3, a process per core")
    for heading in (*headings, "× SB3"):
        table.add_column(heading, justify="left" if heading == "task" else "right")
    rows = []
    for task in TASKS:
        profiled, physics, training, theirs = (median[task, side] for side in ("profiled", "physics", "galton", "sb3"))
        row = {"task": task, "profiled": profiled, "physics": physics, "training": training, "sb3_processes": theirs}
        rows.append(row)
        share = f"{training / physics:.2f}"
        numbers = (f"{profiled:,.0f}", f"{physics:,.0f}", f"{training:,.0f}", share, f"{theirs:,.0f}")
        table.add_row(task, *numbers, f"{training / theirs:.0f}")
    Console().print(table)

    table = Table(title="one run, HalfCheetah-v5 through plain Gymnasium")
    for heading in ("side", "steps/s", "× SB3's counterpart"):
        table.add_column(heading, justify="left" if heading == "side" else "right")
    one = []
    for discrete, name in ((False, "Gaussian"), (True, "MultiDiscrete")):
        one.append({"side": f"SB3 {name}", "steps_per_second": median["one", "sb3", discrete], "ratio": 1.0})
    for loss in ("gaussian", "hl-one-hot", "hl-gauss"):
        speed, theirs = median["one", loss], median["one", "sb3", loss != "gaussian"]
        one.append({"side": f"Galton {galton.LOSSES[loss].label}", "steps_per_second": speed, "ratio": speed / theirs})
    for row in one:
        table.add_row(row["side"], f"{row['steps_per_second']:,.0f}", f"{row['ratio']:.1f}")
    Console().print(table)

    packages = ("mujoco", "gymnasium", "stable-baselines3", "torch")
    rounds = {" ".join(map(str, key)): values for key, values in speeds.items()}
    write(arguments.out / "against_physics.json", packages, populations=rows, one_run=one, rounds=rounds)


if __name__ == "__main__":
    main()
