"""Measure how fast PPO trains: against Stable-Baselines3's PPO with the same settings, both sides in one run.

Mountain Car (in JAX here, Gymnasium's there) and HalfCheetah-v5; SB3's defaults: one environment, 2,048 steps, ten
epochs of minibatches of 64, 64×64 tanh networks. SB3's softmax policy is its MultiDiscrete over k = 41 bin centers,
which is HL-1-Hot. First one run of each in one process, then a process per core, with one run of SB3's and 16 of ours
in each; every process computes on one thread. The arithmetic is that of the networks' matrix products, two operations
per multiplication, in ten epochs and one pass to act, as a share of XLA's product of two 1024×1024 matrices on one
thread. Sides take turns; medians over the rounds. Nothing else should be running.

    python benchmarks/ppo_speed.py [--rounds 5] [--out results/benchmarks]
"""

import argparse
import statistics
from pathlib import Path

import gymnasium
from rich.console import Console
from rich.table import Table
from sides import Discretised, Side, write
from sweep_speed import Peak

from galton_experiments.sweep.executors import one_per_core

K, HIDDEN, EPOCHS = 41, 64, 10
TASKS = {"mountain-car": "MountainCarContinuous-v0", "HalfCheetah-v5": "HalfCheetah-v5"}
SIZES = {"mountain-car": (2, 1), "HalfCheetah-v5": (17, 6)}
"""Entries of an observation and of an action."""


class Theirs:
    """One of SB3's models with one torch thread, trained on for one rollout at a time."""

    def __init__(self, task, discrete):
        import torch
        from stable_baselines3 import PPO

        torch.set_num_threads(1)
        env = gymnasium.make(TASKS[task])
        self.model = PPO("MlpPolicy", Discretised(env, K) if discrete else env, device="cpu", seed=0)
        self.model.learn(2048)

    def advance(self):
        self.model.learn(2048)
        return 2048


class Ours:
    """Runs of ours, trained on for some updates at a time; each ends at a log point."""

    def __init__(self, task, loss, runs, updates):
        import jax

        import galton
        from galton.training.population import populate

        agent = galton.make_agent(algorithm="ppo", loss=loss, n_bins=K, eta=2.0)
        self.population = populate(task, agent, range(runs), jax.devices()[:1])
        self.runs, self.updates = runs, updates
        self.advance()

    def advance(self):
        self.population.advance(self.updates)
        self.population.log()
        return self.updates * 2048 * self.runs


def operations(task, loss):
    """Of the networks' products, per environment step: one pass to act and value, then forwards and backwards."""
    n_in, d = SIZES[task]
    first, second = n_in * HIDDEN, HIDDEN * HIDDEN
    actor = first + second + HIDDEN * d * (1 if loss == "gaussian" else K)
    critic = first + second + HIDDEN
    return 2 * (2 * actor + 2 * critic + EPOCHS * (3 * (actor + critic) - 2 * first))


def main():
    parser = argparse.ArgumentParser()
    parser.add_argument("--rounds", type=int, default=5)
    parser.add_argument("--out", type=Path, default=Path("results/benchmarks"))
    arguments = parser.parse_args()
    places, speeds = one_per_core(None), {}
    for task in TASKS:
        sides = {"peak": Side(places[:1], Peak)}
        for several, where in ((False, places[:1]), (True, places)):
            for discrete in (False, True):
                sides[task, several, "SB3", discrete] = Side(where, Theirs, task, discrete)
            for loss in ("gaussian", "hl-one-hot", "hl-gauss-centred"):
                updates = 8 if task == "mountain-car" else 2
                sides[task, several, "Galton", loss] = Side(where, Ours, task, loss, 16 if several else 1, updates)
        for _ in range(arguments.rounds):
            for key, side in sides.items():
                speeds.setdefault(key, []).append(side.steps_per_second())
        for side in sides.values():
            side.close()
    median = {key: statistics.median(values) for key, values in speeds.items()}

    rows = []
    for task in TASKS:
        for several in (False, True):
            for discrete, name in ((False, "SB3 Gaussian"), (True, "SB3 MultiDiscrete")):
                speed = median[task, several, "SB3", discrete]
                rows.append({"task": task, "per_core": several, "side": name, "steps_per_second": speed, "ratio": 1.0})
            for loss in ("gaussian", "hl-one-hot", "hl-gauss-centred"):
                speed = median[task, several, "Galton", loss]
                cores = len(places) if several else 1
                rows.append(
                    {
                        "task": task,
                        "per_core": several,
                        "side": f"Galton {loss}",
                        "steps_per_second": speed,
                        "ratio": speed / median[task, several, "SB3", loss != "gaussian"],
                        "share_of_peak": speed * operations(task, loss) / (cores * median["peak"]),
                    }
                )
    table = Table(title=f"PPO, k = {K}, median of {arguments.rounds} rounds")
    for heading in ("task", "", "side", "env-steps/s", "× SB3's counterpart", "of the peak"):
        table.add_column(heading)
    for row in rows:
        share = f"{row['share_of_peak']:.0%}" if "share_of_peak" in row else ""
        where = "a process per core" if row["per_core"] else "one run"
        speed, ratio = f"{row['steps_per_second']:,.0f}", f"{row['ratio']:.1f}"
        table.add_row(row["task"], where, row["side"], speed, ratio, share)
    Console().print(table)
    rounds = {" ".join(map(str, key)) if isinstance(key, tuple) else key: values for key, values in speeds.items()}
    write(arguments.out / "ppo_speed.json", ("stable-baselines3", "torch", "mujoco"), rows=rows, rounds=rounds)


if __name__ == "__main__":
    main()
