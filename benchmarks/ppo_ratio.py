"""PPO with each loss and each of the two ratios: final returns on four tasks, five seeds each (the bandit ten).

Eight environments of 256 steps, ten epochs of minibatches of 64, k = 41, a learning rate of 3e-4, observations and
rewards normalised; the bandit has one environment of 64 steps, a linear policy and a learning rate of 0.01. Nothing was
tuned. Each line is kept as it ends, so the command goes on where it stopped:

    python benchmarks/ppo_ratio.py [--tasks lqr ...] [--out results/benchmarks/ppo_ratio.jsonl]
"""

import argparse
import json
from pathlib import Path

import numpy as np

import galton
from galton_experiments.analysis.statistics import mean_interval

TASKS = {"bandit": 20_000, "lqr": 300_000, "acrobot": 300_000, "HalfCheetah-v5": 300_000}
LOSSES = [
    ("gaussian", 0.25, "smoothed"),
    ("hl-one-hot", 0.25, "smoothed"),
    ("hl-gauss", 0.75, "smoothed"),
    ("hl-gauss", 0.75, "true"),
    ("hl-gauss", 2.0, "smoothed"),
    ("hl-gauss", 2.0, "true"),
    ("hl-gauss-centred", 2.0, "smoothed"),
    ("hl-gauss-centred", 2.0, "true"),
]
BANDIT = {"n_steps": 64, "batch_size": 32, "net_arch": (), "normalize_reward": True}
OTHERS = {"n_steps": 256, "n_envs": 8, "normalize_observation": True, "normalize_reward": True}


def measure(task, loss, eta, ratio):
    """The last tenth of training, over seeds."""
    own = BANDIT | {"learning_rate": 0.01} if task == "bandit" else OTHERS
    agent = galton.make_agent(algorithm="ppo", loss=loss, ratio=ratio, n_bins=41, eta=eta, **own)
    seeds = range(10 if task == "bandit" else 5)
    result = galton.train(task, agent, seeds, TASKS[task], n_logs=10, n_eval_episodes=10)
    metrics = ("evaluation_return", "training_return", "approx_kl", "clip_fraction", "entropy")
    finals = {name: np.asarray(result.final(name, 0.1)).tolist() for name in metrics}
    return finals | {"diverged": int((result.diverged_at >= 0).sum())}


def main():
    parser = argparse.ArgumentParser()
    parser.add_argument("--tasks", nargs="+", default=list(TASKS))
    parser.add_argument("--out", type=Path, default=Path("results/benchmarks/ppo_ratio.jsonl"))
    arguments = parser.parse_args()
    arguments.out.parent.mkdir(parents=True, exist_ok=True)
    lines = [json.loads(line) for line in arguments.out.read_text().splitlines()] if arguments.out.exists() else []
    known = {(line["task"], line["loss"], line["eta"], line["ratio"]): line for line in lines}
    galton.use_all_cores()
    for task in arguments.tasks:
        for loss, eta, ratio in LOSSES:
            line = known.get((task, loss, eta, ratio))
            if line is None:
                line = {"task": task, "loss": loss, "eta": eta, "ratio": ratio} | measure(task, loss, eta, ratio)
                with arguments.out.open("a") as file:
                    file.write(json.dumps(line) + "\n")
            deterministic, training = (
                mean_interval(np.array(line[n])) for n in ("evaluation_return", "training_return")
            )
            kl = np.mean(line["approx_kl"])
            print(f"{task:15} {loss:17} η {eta:<5} {ratio:9} {deterministic:.2f}   {training:.2f}   KL {kl:.3f}")


if __name__ == "__main__":
    main()
