"""The distribution in torch in Stable-Baselines3's PPO: what it learns and costs, beside its Gaussian and Galton's PPO.

The numbers are the same everywhere: of Pendulum 4 × 512 steps, γ .9, rate 1e-3, 40,960 steps; of HalfCheetah 8 × 256
steps, rate 3e-4, 300,000 steps; ten epochs of minibatches of 64, observations and rewards normalised, k = 41, η = 2.
The deterministic policy plays 20 episodes in the end. Each line is kept as it ends, so the command goes on where it
stopped, and then prints the table.

    python benchmarks/in_torch.py [--tasks Pendulum-v1] [--seeds 3] [--out results/benchmarks/in_torch.jsonl]

With --cost it measures instead how long an update takes, with the distribution and with SB3's Gaussian in turn.
"""

import argparse
import itertools
import json
import multiprocessing
import os
import statistics
import time
from pathlib import Path

import numpy as np

import galton
from galton_experiments.analysis.statistics import mean_interval

TASKS = {
    "Pendulum-v1": ({"n_envs": 4, "n_steps": 512, "gamma": 0.9, "learning_rate": 1e-3}, 40_960),
    "HalfCheetah-v5": ({"n_envs": 8, "n_steps": 256, "gamma": 0.99, "learning_rate": 3e-4}, 300_000),
}
FIRST_SEED, N_EPISODES, K, ETA = 5000, 20, 41, 2.0
LOSSES = ("hl-gauss-centred", "hl-one-hot")
METHODS = ("SB3, Gaussian", *(f"SB3, {loss}" for loss in LOSSES), "Galton, gaussian", *(f"Galton, {x}" for x in LOSSES))


def sb3_model(task, method, seed):
    """SB3's PPO on normalised copies, with its own policy or with bins."""
    import stable_baselines3
    import torch
    from stable_baselines3.common.env_util import make_vec_env
    from stable_baselines3.common.vec_env import VecNormalize

    from galton.torch.sb3 import HistogramPolicy

    torch.set_num_threads(1)
    words, _ = TASKS[task]
    own = {name: value for name, value in words.items() if name != "n_envs"}
    env = VecNormalize(make_vec_env(task, words["n_envs"], seed=seed), gamma=words["gamma"])
    loss = method.removeprefix("SB3, ")
    policy, bins = (
        ("MlpPolicy", None) if loss == "Gaussian" else (HistogramPolicy, {"loss": loss, "n_bins": K, "eta": ETA})
    )
    return stable_baselines3.PPO(policy, env, policy_kwargs=bins, seed=seed, device="cpu", **own)


def theirs(task, method, seed):
    """The return after training SB3's PPO."""
    from stable_baselines3.common.env_util import make_vec_env
    from stable_baselines3.common.evaluation import evaluate_policy
    from stable_baselines3.common.vec_env import VecNormalize

    model = sb3_model(task, method, seed).learn(TASKS[task][1])
    test = VecNormalize(make_vec_env(task, 1, seed=10_000 + seed), training=False, norm_reward=False)
    test.obs_rms = model.get_env().obs_rms
    return float(evaluate_policy(model, test, N_EPISODES)[0])


def ours(task, method, seed):
    """The return after training Galton's PPO."""
    words, steps = TASKS[task]
    loss = method.removeprefix("Galton, ")
    bins = {"n_bins": K, "bin_centers": "bounds", "deterministic_action": "mean", "initial_policy": "clipped-gaussian"}
    bins |= {"box_units": 1.0, "log_std_init": float(np.log(0.6))}
    if loss != "hl-one-hot":
        bins |= {"eta": ETA, "target_tails": "reflected"}
    normalised = {"normalize_observation": True, "normalize_reward": True}
    agent = galton.make_agent(algorithm="ppo", loss=loss, **words, **normalised, **({} if loss == "gaussian" else bins))
    result = galton.train(task, agent, [seed], steps, n_logs=1, n_eval_episodes=N_EPISODES)
    return float(result.log.evaluation_return[0, -1])


def job(arguments):
    """Do one, and write it down."""
    out, task, method, seed = arguments
    galton.use_all_cores()
    start = time.perf_counter()
    found = (ours if method.startswith("Galton") else theirs)(task, method, seed)
    line = {"task": task, "method": method, "seed": seed, "return": round(found, 3)}
    with out.open("a") as file:
        file.write(json.dumps(line | {"seconds": round(time.perf_counter() - start, 1)}) + "\n")


def read(out):
    """The lines that are there."""
    return list(map(json.loads, out.read_text().splitlines())) if out.exists() else []


def table(lines):
    """Markdown's lines: mean returns with 95% intervals over seeds."""
    yield "| | " + " | ".join(TASKS) + " |\n|---" + "|---" * len(TASKS) + "|"
    for method in METHODS:
        of = [[line["return"] for line in lines if (line["task"], line["method"]) == (task, method)] for task in TASKS]
        yield (
            f"| {method} | "
            + " | ".join(f"{mean_interval(np.array(x)):,.0f}" if len(x) > 1 else "—" for x in of)
            + " |"
        )


def cost(out, rounds=5):
    """Seconds of an update of SB3's PPO on a rollout of HalfCheetah's shape, in turn: medians and their ratio."""
    models = {method: sb3_model("HalfCheetah-v5", method, 0) for method in METHODS[:3]}
    taken = {method: [] for method in models}
    for model in models.values():
        model.learn(1)  # fills the buffer, and is not counted
    for _ in range(rounds):
        for method, model in models.items():
            start = time.perf_counter()
            model.train()
            taken[method].append(time.perf_counter() - start)
    out.write_text(json.dumps(taken, indent=1) + "\n")
    base = statistics.median(taken["SB3, Gaussian"])
    for method, seconds in taken.items():
        print(f"| {method} | {statistics.median(seconds):.2f} s | {statistics.median(seconds) / base:.2f} |")


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--tasks", nargs="+", default=[*TASKS], choices=[*TASKS])
    parser.add_argument("--seeds", type=int, default=3)
    parser.add_argument("--processes", type=int, default=os.cpu_count())
    parser.add_argument("--out", type=Path, default=Path("results/benchmarks/in_torch.jsonl"))
    parser.add_argument("--cost", action="store_true", help="seconds of an update, to in_torch_cost.json beside --out")
    arguments = parser.parse_args()
    if arguments.cost:
        cost(arguments.out.with_name("in_torch_cost.json"))
        return
    known = {(line["task"], line["method"], line["seed"]) for line in read(arguments.out)}
    seeds = range(FIRST_SEED, FIRST_SEED + arguments.seeds)
    jobs = [one for one in itertools.product(arguments.tasks, METHODS, seeds) if one not in known]
    with multiprocessing.get_context("spawn").Pool(arguments.processes, maxtasksperchild=1) as pool:
        pool.map(job, [(arguments.out, *one) for one in jobs], chunksize=1)
    print(*table(read(arguments.out)), sep="\n")


if __name__ == "__main__":
    main()
