"""What each method of a benchmark's file costs: environment steps a second beside the baseline's, all in one run.

Every method has the file's fixed fields and its own first draw, but for k, which is 50 wherever there are bins: k
differs from draw to draw, and what it costs has nothing to do with the method. A process per core trains 16 runs, and
the methods take turns; medians over the rounds, of training without evaluation. Nothing else should be running.

    python benchmarks/method_speed.py [FILE.toml ...] [--tasks lqr HalfCheetah-v5] [--rounds 5] [--out FOLDER]
"""

import argparse
import dataclasses
import statistics
from pathlib import Path

import numpy as np
from rich.console import Console
from rich.table import Table
from sides import Side, write

import galton
from galton.benchmark.draws import draws, setting
from galton.benchmark.reading import read
from galton.sweep.executors import one_per_core
from galton.training.population import populate

K, RUNS = 50, 16
FILES = [Path("benchmarks/winner-a2c.toml"), Path("benchmarks/winner.toml")]


class InTurn:
    """Runs with each of some settings. They take turns, and each is trained for at least so many steps a turn."""

    def __init__(self, task, settings, steps):
        self.trained = []
        for config, hypers in settings:
            each = galton.Hypers._make(np.full(RUNS, value, np.float32) for value in hypers)
            size = config.n_steps * config.n_envs
            self.trained.append((populate(task, config, each, range(RUNS)), -(-steps // size), size * RUNS))
        for _ in settings:
            self.advance()

    def advance(self):
        population, updates, size = self.trained[0]
        self.trained = [*self.trained[1:], self.trained[0]]
        population.advance(updates)
        population.log()
        return updates * size


def settings(protocol, env):
    """What each method is measured with, by its label."""
    drawn, found = draws(protocol), {}
    task = dataclasses.replace(protocol.tuning[0], name=env, env=env, env_kwargs={}, fixed={}, scale={})
    for method in protocol.methods:
        made = setting(protocol, method, drawn[method.name][0], task, fresh=False)
        found[method.label] = dataclasses.replace(made.config, n_bins=K), made.hypers
    return found


def main():
    parser = argparse.ArgumentParser()
    parser.add_argument("files", nargs="*", type=Path, default=FILES)
    parser.add_argument("--tasks", nargs="+", default=["lqr", "HalfCheetah-v5"])
    parser.add_argument("--rounds", type=int, default=5)
    parser.add_argument("--steps", type=int, default=8_000, help="of each run, between two looks at the clock")
    parser.add_argument("--out", type=Path, default=Path("results/benchmarks"))
    arguments = parser.parse_args()
    places, columns = one_per_core(None), {}
    for file in arguments.files:
        protocol = read(file)
        for task in arguments.tasks:
            measured = settings(protocol, task)
            side = Side(places, InTurn, task, [*measured.values()], arguments.steps)
            rounds = [[side.steps_per_second() for _ in measured] for _ in range(arguments.rounds)]
            side.close()
            speeds = dict(zip(measured, zip(*rounds, strict=True), strict=True))
            algorithm = protocol.algorithm(protocol.baseline)
            columns[f"{algorithm.upper()}, {task}"] = speeds, protocol.baseline.label
    rows = {}
    for column, (speeds, baseline) in columns.items():
        base = statistics.median(speeds[baseline])
        for label, found in speeds.items():
            speed = statistics.median(found)
            rows.setdefault(label, {})[column] = {"steps_per_second": speed, "ratio": speed / base, "rounds": found}
    table = Table(title=f"environment steps a second, × the baseline's; k = {K}, median of {arguments.rounds} rounds")
    for heading in ("method", *columns):
        table.add_column(heading)
    for label, row in rows.items():
        cells = (row.get(column) for column in columns)
        table.add_row(label, *(f"{c['steps_per_second']:,.0f} ({c['ratio']:.2f})" if c else "" for c in cells))
    Console(width=140).print(table)
    write(arguments.out / "method_speed.json", ("mujoco",), rows=rows)


if __name__ == "__main__":
    main()
