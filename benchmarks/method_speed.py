"""Measure what each method of the benchmarks costs: environment steps a second beside the Gaussian's, all in one run.

Every method has its file's fixed fields and its own first draw, but for k, which is 50 wherever there are bins: k
differs from draw to draw, and what it costs has nothing to do with the method. A process per core trains 16 runs, and
the methods take turns; medians over the rounds, of training without evaluation. Nothing else should be running.
MuJoCo's table stands in docs/winner.md.

    python benchmarks/method_speed.py [--rounds 5] [--steps 8000] [--out FOLDER]
"""

import argparse
import dataclasses
import statistics
from pathlib import Path

from sides import Side, write

from galton.training.population import populate
from galton_experiments.benchmark.draws import draws, setting
from galton_experiments.benchmark.reading import read
from galton_experiments.page import quotes
from galton_experiments.sweep.executors import one_per_core

K, RUNS = 50, 16
TABLES = {
    "analytic": (("A2C, LQR", "winner-a2c", "lqr"), ("PPO, LQR", "winner", "lqr")),
    "mujoco": (("PPO, HalfCheetah", "winner-mujoco", "HalfCheetah-v5"),),
}
"""The tables, and of each column: heading, file and task."""


class InTurn:
    """Runs of each of some agents. They take turns, and each is trained for at least so many steps a turn."""

    def __init__(self, task, agents, steps):
        self.trained = []
        for agent in agents:
            size, population = agent.rollout.size, populate(task, agent, range(RUNS))
            self.trained.append((population, -(-steps // size), size * RUNS))
        for _ in agents:
            self.advance()

    def advance(self):
        population, updates, size = self.trained[0]
        self.trained = [*self.trained[1:], self.trained[0]]
        population.advance(updates)
        population.log()
        return updates * size


def agents(protocol, env):
    """Return the agent that each method is measured with, by its label."""
    drawn, found = draws(protocol), {}
    task = dataclasses.replace(protocol.tuning[0], name=env, env=env, env_kwargs={}, fixed={}, scale={})
    for method in protocol.methods:
        made = setting(protocol, method, drawn[method.name][0], task, fresh=False)
        found[method.label] = made.replace(n_bins=K).agent
    return found


def measured(file, env, places, rounds, steps):
    """Each method's steps per second in each round, by its label, the baseline first."""
    return in_turn(agents(read(Path("benchmarks") / f"{file}.toml"), env), env, places, rounds, steps)


def in_turn(agents, env, places, rounds, steps):
    """Each agent's steps per second in each round, by its label."""
    side = Side(places, InTurn, env, [*agents.values()], steps)
    found = [[side.steps_per_second() for _ in agents] for _ in range(rounds)]
    side.close()
    return dict(zip(agents, zip(*found, strict=True), strict=True))


def table(columns):
    """Medians, and their ratios to the baseline's, which is the first method: it stands first in each file."""
    cells = {}
    for heading, speeds in columns.items():
        medians = {label: statistics.median(found) for label, found in speeds.items()}
        base = next(iter(medians.values()))
        for label, median in medians.items():
            cells.setdefault(label, {})[heading] = f"{median:,.0f} (× {median / base:.2f})"
    return quotes.markdown(["method", *columns], [[label, *row.values()] for label, row in cells.items()])


def main():
    parser = argparse.ArgumentParser()
    parser.add_argument("--rounds", type=int, default=5)
    parser.add_argument("--steps", type=int, default=8_000, help="of each run, between two looks at the clock")
    parser.add_argument("--out", type=Path, default=Path("results/benchmarks"))
    parser.add_argument("--documents", type=Path, nargs="*", default=[Path("docs/winner.md")])
    arguments = parser.parse_args()
    places, tables = one_per_core(None), {}
    for name, columns in TABLES.items():
        tables[name] = {
            heading: measured(file, env, places, arguments.rounds, arguments.steps) for heading, file, env in columns
        }
    written = {f"method_speed: {name}": table(columns) for name, columns in tables.items()}
    print(*written.values(), sep="\n\n")
    write(arguments.out / "method_speed.json", ("jax", "mujoco"), k=K, steps_per_second=tables)
    quotes.write(written.get, arguments.documents)


if __name__ == "__main__":
    main()
