"""Test whether our Gaussian PPO learns what Stable-Baselines3's learns: the same settings, five seeds each.

CleanRL's settings (but for its clipping of the value loss, which SB3 has in another form): one environment, 2,048
steps, 10 epochs of minibatches of 64, a learning rate that falls from 3e-4 to 0, observations and rewards normalised
(SB3's VecNormalize). A run has two scores: the mean undiscounted return of the training episodes that ended in its
last tenth, and the mean return of 20 episodes of its final deterministic policy.

Each run is kept as it ends, so the command goes on where it stopped:

    python benchmarks/ppo_learning.py [sb3] [galton] [--seeds 5] [--tasks HalfCheetah-v5 ...] [--out FILE]
"""

import argparse
import json
import multiprocessing
import os
import time
from pathlib import Path

import numpy as np

TASKS = ("HalfCheetah-v5", "Hopper-v5", "Walker2d-v5")
STEPS = 1_000_000
SETTINGS = {
    "n_steps": 2048,
    "batch_size": 64,
    "n_epochs": 10,
    "gamma": 0.99,
    "gae_lambda": 0.95,
    "clip_range": 0.2,
    "ent_coef": 0.0,
    "vf_coef": 0.5,
    "max_grad_norm": 0.5,
}
LEARNING_RATE = 3e-4


def sb3(task, seed):
    """The scores of one of SB3's runs."""
    import gymnasium
    import torch
    from stable_baselines3 import PPO
    from stable_baselines3.common.env_util import make_vec_env
    from stable_baselines3.common.vec_env import VecNormalize

    torch.set_num_threads(1)
    env = VecNormalize(make_vec_env(task, 1, seed=seed), gamma=SETTINGS["gamma"])
    model = PPO("MlpPolicy", env, learning_rate=lambda left: LEARNING_RATE * left, device="cpu", seed=seed, **SETTINGS)
    returns = []

    def on_step(local, _):
        returns.extend((model.num_timesteps, info["episode"]["r"]) for info in local["infos"] if "episode" in info)
        return True

    model.learn(STEPS, callback=on_step)
    test, scores = gymnasium.make(task), []
    for episode in range(20):
        observation, _ = test.reset(seed=1_000_000 + 1_000 * seed + episode)
        scores.append(0.0)
        done = False
        while not done:
            action, _ = model.predict(env.normalize_obs(observation), deterministic=True)
            observation, reward, terminated, truncated, _ = test.step(action)
            scores[-1] += float(reward)
            done = terminated or truncated
    last = [value for step, value in returns if step > 0.9 * STEPS]
    return float(np.mean(last)), float(np.mean(scores))


def run(job):
    """One run of SB3's, written down."""
    out, task, seed = job
    start = time.perf_counter()
    training, evaluation = sb3(task, seed)
    line = {"side": "sb3", "task": task, "seed": seed, "training_return": training, "evaluation_return": evaluation}
    with out.open("a") as file:
        file.write(json.dumps(line | {"seconds": time.perf_counter() - start}) + "\n")


def galton_runs(job):
    """All of our runs on one task, side by side on one core, written down."""
    out, task, seeds = job
    import jax

    import galton
    from galton.training.population import populate

    galton.use_all_cores()
    start = time.perf_counter()
    own = {
        "normalize_observation": True,
        "normalize_reward": True,
        "learning_rate": LEARNING_RATE,
        "decay_steps": STEPS,
    }
    agent = galton.make_agent(algorithm="ppo", loss="gaussian", **own, **SETTINGS)
    population = populate(task, agent, seeds, jax.devices()[:1])
    n_updates = -(-STEPS // SETTINGS["n_steps"])
    population.advance(round(0.9 * n_updates))
    population.log()
    population.advance(n_updates - round(0.9 * n_updates))
    training, evaluation = population.log().training_return, population.evaluate(20).mean(1)
    population.close()
    seconds = (time.perf_counter() - start) / len(seeds)
    with out.open("a") as file:
        for seed, *scores in zip(seeds, training, evaluation, strict=True):
            named = dict(zip(("training_return", "evaluation_return"), map(float, scores), strict=True))
            line = {"side": "galton", "task": task, "seed": seed} | named | {"seconds": seconds}
            file.write(json.dumps(line) + "\n")


def summarise(out):
    """Means and 95% intervals of both sides, side by side."""
    from galton_experiments.analysis.statistics import mean_interval

    runs = known(out).values()
    for task in dict.fromkeys(run["task"] for run in runs):
        for side in ("sb3", "galton"):
            own = [run for run in runs if (run["side"], run["task"]) == (side, task)]
            for score in ("training_return", "evaluation_return") if own else ():
                interval = mean_interval(np.array([run[score] for run in own]))
                print(f"{task} {side} {score}: {interval:,.0f} ({len(own)} runs)")


def known(out):
    """The runs that are done."""
    lines = [json.loads(line) for line in out.read_text().splitlines()] if out.exists() else []
    return {(line["side"], line["task"], line["seed"]): line for line in lines}


def main():
    parser = argparse.ArgumentParser()
    parser.add_argument("sides", nargs="*", default=["sb3", "galton"])
    parser.add_argument("--seeds", type=int, default=5)
    parser.add_argument("--tasks", nargs="+", default=list(TASKS))
    parser.add_argument("--out", type=Path, default=Path("results/benchmarks/ppo_learning.jsonl"))
    arguments = parser.parse_args()
    arguments.out.parent.mkdir(parents=True, exist_ok=True)
    if "sb3" in arguments.sides:
        jobs = [(arguments.out, task, seed) for seed in range(arguments.seeds) for task in arguments.tasks]
        jobs = [job for job in jobs if ("sb3", *job[1:]) not in known(arguments.out)]
        with multiprocessing.get_context("spawn").Pool(len(os.sched_getaffinity(0))) as pool:
            pool.map(run, jobs, chunksize=1)
    if "galton" in arguments.sides:
        done = known(arguments.out)
        missing = {t: [s for s in range(arguments.seeds) if ("galton", t, s) not in done] for t in arguments.tasks}
        jobs = [(arguments.out, task, seeds) for task, seeds in missing.items() if seeds]
        with multiprocessing.get_context("spawn").Pool(len(os.sched_getaffinity(0)), maxtasksperchild=1) as pool:
            pool.map(galton_runs, jobs, chunksize=1)
    summarise(arguments.out)


if __name__ == "__main__":
    main()
