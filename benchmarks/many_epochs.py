"""When is the loss in log_prob safe? The numbers of Playground's PPO, 16 epochs of 32 minibatches, on HalfCheetah.

A loss with a Gaussian target moves the bins around an action too, which PPO's clip does not look at. Heads, widths and
head scales are trained with these numbers, and one of them with what may hold it: fewer epochs, a bound on the KL
divergence, a smaller rate. Each job, three seeds of one of them, is kept as it ends, so the command goes on where it
stopped, and ends with its table.

    python benchmarks/many_epochs.py [--processes 2] [--out results/benchmarks/many_epochs.jsonl]
"""

import argparse
import json
import math
import multiprocessing
import os
import time
from pathlib import Path

import jax
import numpy as np

import galton

SEEDS, STEPS, TASK = range(6000, 6003), 600_000, "HalfCheetah-v5"
COMMON = {
    "algorithm": "ppo",
    "n_envs": 32,
    "n_steps": 480,
    "batch_size": 480,
    "n_epochs": 16,
    "learning_rate": 1e-3,
    "gamma": 0.99,
    "clip_range": 0.3,
    "normalize_observation": True,
    "normalize_reward": True,
}
BINS = {"n_bins": 41, "bin_centers": "bounds", "deterministic_action": "mean", "initial_policy": "clipped-gaussian"}
BINS |= {"box_units": 1.0, "log_std_init": math.log(0.6)}


def centred(eta, head_scale, **others):
    """The settings of a head with centred HL-Gauss."""
    words = {"loss": "hl-gauss-centred", "eta": eta, "target_tails": "reflected", "head_scale": head_scale}
    return BINS | words | others


HEADS = {
    "Gaussian": {"loss": "gaussian"},
    "one-hot, S = 4": {"loss": "hl-one-hot", "head_scale": 4.0} | BINS,
    "η = 2": centred(2.0, 1.0),
    "η = 1, S = 4": centred(1.0, 4.0),
    "η = 2, S = 4": centred(2.0, 4.0),
    "η = 4, S = 4": centred(4.0, 4.0),
    "η = 2, S = 4, 4 epochs": centred(2.0, 4.0, n_epochs=4),
    "η = 2, S = 4, KL .03": centred(2.0, 4.0, target_kl=0.03),
    "η = 2, S = 4, rate 3e-4": centred(2.0, 4.0, learning_rate=3e-4),
    "η = 2, S = 4, gradients not clipped": centred(2.0, 4.0, max_grad_norm=1e9),
}


def train(job):
    """Train three runs of one head on one core, and write down what they tell."""
    out, head = job
    galton.use_all_cores()
    start = time.perf_counter()
    agent = galton.make_agent(**COMMON | HEADS[head])
    result = galton.train(TASK, agent, SEEDS, STEPS, n_logs=25, n_eval_episodes=5, devices=jax.devices()[:1])
    line = {"head": head, "steps": int(result.steps[-1]), "version": galton.__version__}
    columns = result.log.columns()
    names = ("evaluation_return", "approx_kl", "clip_fraction", "ratio_max", "entropy", "n_minibatches")
    line |= {name: np.asarray(columns[name], float).round(4).tolist() for name in names}
    with out.open("a") as file:
        file.write(json.dumps(line | {"seconds": round(time.perf_counter() - start, 1)}) + "\n")


def read(out):
    """The lines that are there, by head."""
    return {line["head"]: line for line in map(json.loads, out.read_text().splitlines())} if out.exists() else {}


def table(done):
    """Markdown's lines: means over seeds, and the largest KL divergence and ratio of any log point."""
    yield "| | best | last | runs that lost half | KL, mean | KL, largest | ratio, largest |"
    yield "|---|---|---|---|---|---|---|"
    for head, line in done.items():
        curves, kl = np.array(line["evaluation_return"]), np.array(line["approx_kl"])
        best, last = curves.max(1), curves[:, -3:].mean(1)
        lost, ratio = int((last < best / 2).sum()), np.max(line["ratio_max"])
        told = (f"{best.mean():,.0f}", f"{last.mean():,.0f}", f"{lost} of {len(best)}", f"{kl.mean():.3f}")
        yield f"| {head} | " + " | ".join(told) + f" | {kl.max():.3f} | {ratio:.3g} |"


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--processes", type=int, default=os.cpu_count())
    parser.add_argument("--out", type=Path, default=Path("results/benchmarks/many_epochs.jsonl"))
    arguments = parser.parse_args()
    jobs = [(arguments.out, head) for head in HEADS if head not in read(arguments.out)]
    with multiprocessing.get_context("spawn").Pool(arguments.processes, maxtasksperchild=1) as pool:
        pool.map(train, jobs, chunksize=1)
    print(*table(read(arguments.out)), sep="\n")


if __name__ == "__main__":
    main()
