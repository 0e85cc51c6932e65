"""Measure what doing nothing earns on the tasks of a benchmark's file that are Gymnasium's.

Nothing is the middle of the box at each step. The table stands in docs/winner.md.

    python benchmarks/doing_nothing.py benchmarks/winner-mujoco.toml [--episodes 100]
"""

import argparse
from pathlib import Path

import gymnasium
from sides import write

from galton_experiments.analysis.statistics import mean_interval
from galton_experiments.benchmark.reading import read


def returns(env, episodes):
    """The return of each episode with seeds 0, 1, ..."""
    found = []
    for seed in range(episodes):
        env.reset(seed=seed)
        total, ended = 0.0, False
        while not ended:
            _, reward, terminated, truncated, _ = env.step((env.action_space.low + env.action_space.high) / 2)
            total, ended = total + float(reward), terminated or truncated
        found.append(total)
    return found


def main():
    parser = argparse.ArgumentParser()
    parser.add_argument("file", type=Path)
    parser.add_argument("--episodes", type=int, default=100)
    parser.add_argument("--out", type=Path, default=Path("results/benchmarks"))
    arguments = parser.parse_args()
    rows = {}
    for task in read(arguments.file).tasks:
        if task.env in gymnasium.registry:
            found = mean_interval(returns(gymnasium.make(task.env, **task.env_kwargs), arguments.episodes))
            rows[task.label] = {"mean": float(found.mean), "low": float(found.low), "high": float(found.high)}
            print(f"{task.label}: {found:,.1f}")
    write(arguments.out / "doing_nothing.json", ("gymnasium", "mujoco"), episodes=arguments.episodes, rows=rows)


if __name__ == "__main__":
    main()
