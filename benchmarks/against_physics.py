"""Training on MuJoCo against the bare physics and against Stable-Baselines3, all sides in one run.

Populations: 64 runs of HL-Gauss at k = 100, 20 steps an update, beside `mujoco.batch` stepping 64 simulations with
random actions on as many threads (for Ant, whose contact forces it does not compute, a loop over MjData in threads),
and beside one SB3 process per core with A2C on MultiDiscrete. One run: HalfCheetah-v5 through plain Gymnasium.
SB3 takes one torch thread, which is its faster setting. Sides take turns; medians over the rounds. Nothing else
should be running.

    python benchmarks/against_physics.py [--rounds 3] [--out results/benchmarks]
"""

import argparse
import importlib.metadata
import json
import multiprocessing
import platform
import statistics
import time
from pathlib import Path

import gymnasium
import numpy as np
import torch
from against_sb3 import Discretised, K
from rich.console import Console
from rich.table import Table
from stable_baselines3 import A2C

import galton
from galton.cores import n_cores
from galton.training.populate import populate

RUNS = 64
TASKS = ("Reacher-v5", "HalfCheetah-v5", "Ant-v5")


class SB3:
    """One of SB3's models, trained on in slices."""

    def __init__(self, task, discrete):
        torch.set_num_threads(1)
        env = gymnasium.make(task)
        env = Discretised(env) if discrete else env
        self.model = A2C("MlpPolicy", env, n_steps=20, gae_lambda=1.0, use_rms_prop=False, device="cpu", seed=0)
        self.model.learn(400)

    def steps_per_second(self, steps=1_500):
        start = time.perf_counter()
        self.model.learn(steps)
        return steps / (time.perf_counter() - start)


def sb3_process(task):
    """MultiDiscrete, in a process of its own beside others."""
    return SB3(task, discrete=True).steps_per_second()


def sb3_processes(task):
    """Steps per second of one process per core, together."""
    with multiprocessing.get_context("spawn").Pool(n_cores()) as pool:
        return sum(pool.map(sb3_process, [task] * n_cores(), chunksize=1))


class Physics:
    """The simulations alone."""

    def __init__(self, task):
        self.envs = galton.envs.find(task).make(RUNS, n_cores())
        self.envs.reset(np.arange(RUNS))
        self.control = np.random.default_rng(0).uniform(-1, 1, (50, RUNS, self.envs._actions.low.size))

    def steps_per_second(self):
        substeps = self.envs._constants.frame_skip
        start = time.perf_counter()
        for control in self.control:
            self.envs._simulations.step(control, substeps)
        return len(self.control) * RUNS / (time.perf_counter() - start)


class Ours:
    """Runs of ours, trained on in slices."""

    def __init__(self, env, loss, runs, updates):
        hypers = galton.Hypers._make(np.full(runs, value, np.float32) for value in galton.Hypers())
        self.population = populate(env, galton.Config(loss=loss, n_bins=K), hypers, range(runs), 10)
        self.runs, self.updates = runs, updates
        self.population.advance(2)

    def steps_per_second(self):
        start = time.perf_counter()
        self.population.advance(self.updates)
        return self.updates * 20 * self.runs / (time.perf_counter() - start)


def main():
    parser = argparse.ArgumentParser()
    parser.add_argument("--rounds", type=int, default=3)
    parser.add_argument("--out", type=Path, default=Path("results/benchmarks"))
    arguments = parser.parse_args()
    galton.use_all_cores()

    def plain():
        return gymnasium.make("HalfCheetah-v5")

    sides = {(task, "physics"): Physics(task) for task in TASKS}
    sides |= {(task, "galton"): Ours(task, "hl-gauss", RUNS, 10) for task in TASKS}
    sides |= {("one", "sb3", discrete): SB3("HalfCheetah-v5", discrete) for discrete in (False, True)}
    sides |= {("one", loss): Ours(plain, loss, 1, 150) for loss in ("gaussian", "hl-one-hot", "hl-gauss")}
    speeds = {key: [] for key in sides} | {(task, "sb3"): [] for task in TASKS}
    for _ in range(arguments.rounds):
        for key, side in sides.items():
            speeds[key].append(side.steps_per_second())
        for task in TASKS:
            speeds[task, "sb3"].append(sb3_processes(task))
    median = {key: statistics.median(values) for key, values in speeds.items()}

    table = Table(title=f"{RUNS} runs, HL-Gauss, k = {K}; {n_cores()} cores, median of {arguments.rounds} rounds")
    for heading in ("task", "physics alone", "training", "share of physics", "SB3, a process per core", "× SB3"):
        table.add_column(heading, justify="left" if heading == "task" else "right")
    rows = []
    for task in TASKS:
        physics, training, theirs = (median[task, side] for side in ("physics", "galton", "sb3"))
        rows.append({"task": task, "physics": physics, "training": training, "sb3_processes": theirs})
        numbers = (f"{physics:,.0f}", f"{training:,.0f}", f"{training / physics:.2f}", f"{theirs:,.0f}")
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

    names = ("galton", "jax", "mujoco", "gymnasium", "stable-baselines3", "torch")
    record = {
        "cores": n_cores(),
        "machine": platform.processor() or platform.machine(),
        "versions": {name: importlib.metadata.version(name) for name in names},
        "populations": rows,
        "one_run": one,
        "rounds": {" ".join(map(str, key)): values for key, values in speeds.items()},
    }
    arguments.out.mkdir(parents=True, exist_ok=True)
    (arguments.out / "against_physics.json").write_text(json.dumps(record, indent=2) + "\n")


if __name__ == "__main__":
    main()
