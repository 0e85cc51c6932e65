"""Score PPO on MuJoCo with tuned settings: the deterministic policy's return after 1M steps, five seeds each.

The settings were chosen by hand on seeds 100 and up; FIRST_STD says what was tried. The scores are of seeds 0 to 4.
Each task is kept as it ends, so the command goes on where it stopped, and ends with a table:

    python benchmarks/ppo_scores.py [--tasks HalfCheetah-v5 ...] [--out FILE]
"""

import argparse
import json
import multiprocessing
import os
import time
from pathlib import Path

import numpy as np

STEPS = 1_000_000
SHARED = {
    "n_envs": 8,
    "n_steps": 256,
    "batch_size": 64,
    "n_epochs": 10,
    "n_bins": 41,
    "normalize_observation": True,
    "normalize_reward": True,
    "learning_rate": 3e-4,
    "decay_steps": STEPS,
}
FIRST_STD = {"HalfCheetah-v5": -0.5, "Reacher-v5": -0.5, "Ant-v5": -2.0}
"""The logarithm of the first σ on each task.

Tried, with the return of each seed: on HalfCheetah log σ₀ = −0.5, 5,288 (100) and 6,879 (101); on Ant log σ₀ = −0.5,
854 (100) and 1,410 (101), and −2, 2,543 (100); on Reacher log σ₀ = −0.5, −4.2 (100) and −4.0 (101). Nothing else was
tried.
"""


def score(job):
    """The final deterministic returns on one task, all seeds side by side on one core, written down."""
    out, task, seeds, settings = job
    import jax

    import galton
    from galton.training.population import populate

    galton.use_all_cores()
    start = time.perf_counter()
    agent = galton.make_agent(algorithm="ppo", loss="gaussian", **settings)
    population = populate(task, agent, seeds, jax.devices()[:1])
    population.advance(-(-STEPS // agent.rollout.size))
    returns = population.evaluate(20).mean(1)
    population.close()
    line = {"task": task, "loss": "gaussian", "settings": settings, "seeds": seeds, "returns": returns.tolist()}
    with out.open("a") as file:
        file.write(json.dumps(line | {"seconds": time.perf_counter() - start}) + "\n")


def main():
    parser = argparse.ArgumentParser()
    parser.add_argument("--tasks", nargs="+", default=list(FIRST_STD), choices=list(FIRST_STD))
    parser.add_argument("--seeds", nargs="+", type=int, default=list(range(5)))
    parser.add_argument("--change", type=json.loads, default={}, help="settings to try, as JSON")
    parser.add_argument("--out", type=Path, default=Path("results/benchmarks/ppo_scores.jsonl"))
    arguments = parser.parse_args()
    arguments.out.parent.mkdir(parents=True, exist_ok=True)
    lines = [json.loads(line) for line in arguments.out.read_text().splitlines()] if arguments.out.exists() else []
    jobs = []
    for task in arguments.tasks:
        settings = SHARED | {"log_std_init": FIRST_STD[task]} | arguments.change
        done = [line["seeds"] for line in lines if (line["task"], line["settings"]) == (task, settings)]
        if seeds := sorted(set(arguments.seeds).difference(*done)):
            jobs.append((arguments.out, task, seeds, settings))
    with multiprocessing.get_context("spawn").Pool(len(os.sched_getaffinity(0)), maxtasksperchild=1) as pool:
        pool.map(score, jobs, chunksize=1)
    summarise(arguments.out)


def summarise(out):
    """Means and 95% intervals over seeds 0 to 4, whichever lines they are in."""
    from galton_experiments.analysis.statistics import mean_interval

    returns = {}
    for line in map(json.loads, out.read_text().splitlines()):
        runs = zip(line["seeds"], line["returns"], strict=True)
        own = returns.setdefault((line["task"], line["settings"]["log_std_init"]), {})
        own |= {seed: value for seed, value in runs if seed < 5}
    for (task, log_std), own in returns.items():
        if len(own) > 1:
            interval = mean_interval(np.array(list(own.values())))
            print(f"{task}, log σ₀ {log_std:g}: {interval:,.1f} ({len(own)} runs)")


if __name__ == "__main__":
    main()
