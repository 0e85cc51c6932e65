"""Score PPO's two presets on six tasks: the deterministic policy's return at the end, five seeds each.

All are trained for 500,000 steps, but for Reacher, which has a million. Each job,
one preset on one task, is kept as it ends, so the command goes on where it stopped, and ends with a table. Times are
those of one core, five runs side by side.

    python benchmarks/presets.py [--tasks LQR ...] [--seeds 0 1 2 3 4] [--out results/benchmarks/presets.jsonl]
"""

import argparse
import json
import multiprocessing
import os
import time
from pathlib import Path

import numpy as np
from scipy import stats

TASKS = {"lqr": 500_000, "acrobot": 500_000, "Reacher-v5": 1_000_000}
TASKS |= dict.fromkeys(("Hopper-v5", "HalfCheetah-v5", "Ant-v5"), 500_000)
NAMES = ("gaussian", "classification")


def score(job):
    """Train one preset on one task, all seeds side by side on one core, and write its returns down."""
    out, task, name, seeds = job
    import jax

    import galton
    from galton.presets import PRESETS

    galton.use_all_cores()
    start = time.perf_counter()
    preset = PRESETS[name]["ppo"]
    agent = galton.make_agent(algorithm="ppo", loss=preset.loss, **preset.settings)
    result = galton.train(task, agent, seeds, TASKS[task], n_logs=10, n_eval_episodes=20, devices=jax.devices()[:1])
    line = {"task": task, "preset": name, "seeds": list(seeds), "steps": int(result.steps[-1])}
    line |= {"returns": np.asarray(result.log.evaluation_return)[:, -1].tolist()}
    line |= {"curves": np.asarray(result.log.evaluation_return).round(3).tolist()}
    line |= {"train_seconds": result.train_seconds, "seconds": time.perf_counter() - start}
    with out.open("a") as file:
        file.write(json.dumps(line) + "\n")


def read(out):
    """The jobs that are done, by task, preset and seeds."""
    lines = [json.loads(line) for line in out.read_text().splitlines()] if out.exists() else []
    return {(line["task"], line["preset"], tuple(line["seeds"])): line for line in lines}


def interval(returns):
    """The mean of some runs, and half the width of its 95% interval by Student's t."""
    n = len(returns)
    return np.mean(returns), stats.t.ppf(0.975, n - 1) * np.std(returns, ddof=1) / np.sqrt(n)


def main():
    parser = argparse.ArgumentParser()
    parser.add_argument("--tasks", nargs="+", default=list(TASKS))
    parser.add_argument("--seeds", nargs="+", type=int, default=list(range(5)))
    parser.add_argument("--processes", type=int, default=os.cpu_count())
    parser.add_argument("--out", type=Path, default=Path("results/benchmarks/presets.jsonl"))
    arguments = parser.parse_args()
    seeds = tuple(arguments.seeds)
    jobs = [(arguments.out, task, name, seeds) for task in arguments.tasks for name in NAMES]
    missing = [job for job in jobs if job[1:] not in read(arguments.out)]
    with multiprocessing.get_context("spawn").Pool(arguments.processes, maxtasksperchild=1) as pool:
        pool.map(score, missing, chunksize=1)
    done = read(arguments.out)
    print("| task | " + " | ".join(NAMES) + " |\n|---|---|---|")
    for task in arguments.tasks:
        cells = ["{:,.2f} ± {:,.2f}".format(*interval(done[task, name, seeds]["returns"])) for name in NAMES]
        print(f"| {task} | " + " | ".join(cells) + " |")


if __name__ == "__main__":
    main()
