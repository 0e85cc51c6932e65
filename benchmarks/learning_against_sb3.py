"""Test whether our Gaussian A2C learns what Stable-Baselines3's learns: the same settings, five seeds each.

Both sides take n_envs environments, the running normalisation of observations and rewards (SB3's VecNormalize), and
Adam. The score of a run is the mean undiscounted return of the training episodes that ended in its last tenth. An exact
rank test, two-sided, says whether they differ.

    python benchmarks/learning_against_sb3.py [--seeds 5] [--out results/benchmarks]
"""

import argparse
import json
import multiprocessing
from pathlib import Path

import numpy as np
from scipy import stats

from galton_experiments.analysis.statistics import mean_interval

TASKS = {
    "HalfCheetah-v5": (300_000, {"n_envs": 4, "n_steps": 8, "gamma": 0.99, "gae_lambda": 0.9}),
    "Pendulum-v1": (100_000, {"n_envs": 8, "n_steps": 8, "gamma": 0.9, "gae_lambda": 0.9}),
}
SHARED = {"learning_rate": 7e-4, "vf_coef": 0.5, "ent_coef": 0.0, "max_grad_norm": 0.5}


def sb3(arguments):
    """The score of one of SB3's runs."""
    import torch
    from stable_baselines3 import A2C
    from stable_baselines3.common.env_util import make_vec_env
    from stable_baselines3.common.vec_env import VecNormalize

    task, seed = arguments
    torch.set_num_threads(1)
    steps, settings = TASKS[task]
    settings = SHARED | settings
    env = make_vec_env(task, settings.pop("n_envs"), seed=seed)
    env = VecNormalize(env, gamma=settings["gamma"])
    model = A2C("MlpPolicy", env, use_rms_prop=False, device="cpu", seed=seed, **settings)
    returns = []

    def on_step(local, _):
        returns.extend((model.num_timesteps, info["episode"]["r"]) for info in local["infos"] if "episode" in info)
        return True

    model.learn(steps, callback=on_step)
    return float(np.mean([value for step, value in returns if step > 0.9 * steps]))


def ours(task, seeds):
    """The scores of our runs, and all of them as a population."""
    import galton

    steps, settings = TASKS[task]
    settings = SHARED | settings
    normalized = {"normalize_observation": True, "normalize_reward": True}
    agent = galton.make_agent(loss="gaussian", **normalized, **settings)
    result = galton.train(task, agent, seeds, steps, n_logs=100, n_eval_episodes=0)
    last = slice(-10, None)
    weights = result.log.n_episodes[:, last]
    return (np.nan_to_num(result.log.training_return[:, last]) * weights).sum(1) / weights.sum(1)


def main():
    parser = argparse.ArgumentParser()
    parser.add_argument("--seeds", type=int, default=5)
    parser.add_argument("--out", type=Path, default=Path("results/benchmarks"))
    arguments = parser.parse_args()
    record = {}
    for task, (steps, settings) in TASKS.items():
        with multiprocessing.get_context("spawn").Pool(2) as pool:
            theirs = np.array(pool.map(sb3, [(task, seed) for seed in range(arguments.seeds)], chunksize=1))
        mine = ours(task, range(arguments.seeds))
        interval = mean_interval(theirs)
        record[task] = {
            "steps": steps,
            "settings": SHARED | settings,
            "sb3": theirs.tolist(),
            "galton": mine.tolist(),
            "sb3_mean": float(interval.mean),
            "sb3_95_ci": [float(interval.low), float(interval.high)],
            "galton_mean": float(mine.mean()),
            "p_rank_test_two_sided": float(stats.mannwhitneyu(mine, theirs, method="exact").pvalue),
        }
        print(f"{task}: SB3 {interval:.1f}, Galton {mean_interval(mine):.1f}")
    arguments.out.mkdir(parents=True, exist_ok=True)
    (arguments.out / "learning_against_sb3.json").write_text(json.dumps(record, indent=2) + "\n")


if __name__ == "__main__":
    main()
