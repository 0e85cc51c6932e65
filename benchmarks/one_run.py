"""Measure how fast one run of PPO trains on HalfCheetah, beside Stable-Baselines3's and sbx's.

One copy of the environment or eight, rollouts of 2,048 steps in all, ten epochs of minibatches of 64, 64×64 tanh
networks, observations and rewards normalised (with VecNormalize there). All have the whole machine; torch computes on
one thread, which is faster at these sizes. Every side is a process of its own, and they take turns; medians over the
rounds. Nothing else should be running. Run it where `make bench` installs sbx:

    .venv-rejax/bin/python benchmarks/one_run.py [--rounds 5] [--out results/benchmarks/one_run.json]
"""

import argparse
import datetime
import json
import multiprocessing
import os
import platform
import statistics
import time
from pathlib import Path

STEPS, TASK = 2048, "HalfCheetah-v5"
CENTRED = {"loss": "hl-gauss-centred", "n_bins": 41, "eta": 2.0, "bin_centers": "bounds", "target_tails": "reflected"}
SIDES = {
    "SB3 Gaussian": ("sb3", {}),
    "sbx Gaussian": ("sbx", {}),
    "Galton Gaussian": ("galton", {"loss": "gaussian"}),
    "Galton Discretised Gaussian": (
        "galton",
        {"loss": "hl-one-hot", "policy": "discretised-gaussian", "n_bins": 41, "bin_centers": "bounds"},
    ),
    "Galton Centred HL-Gauss": ("galton", CENTRED),
}


def theirs(library, n_envs):
    """A function that trains one of Stable-Baselines3's models, or sbx's, for a rollout."""
    import gymnasium
    import torch
    from stable_baselines3.common.vec_env import DummyVecEnv, VecNormalize

    if library == "sbx":
        from sbx import PPO
    else:
        from stable_baselines3 import PPO
    torch.set_num_threads(1)
    env = VecNormalize(DummyVecEnv([lambda: gymnasium.make(TASK)] * n_envs))
    model = PPO("MlpPolicy", env, n_steps=STEPS // n_envs, batch_size=64, n_epochs=10, seed=0)
    return lambda: model.learn(STEPS, reset_num_timesteps=False)


def ours(settings, n_envs):
    """A function that trains one of ours for a rollout."""
    import galton
    from galton.training.population import populate

    galton.use_all_cores(runs=1)
    normalised = {"normalize_observation": True, "normalize_reward": True}
    agent = galton.make_agent(algorithm="ppo", n_envs=n_envs, n_steps=STEPS // n_envs, **normalised, **settings)
    population = populate(TASK, agent, [0])

    def advance():
        population.advance(1)
        population.log()

    return advance


def work(pipe, name, n_envs):
    """Answer each question with the steps per second of some rollouts."""
    library, settings = SIDES[name]
    advance = ours(settings, n_envs) if library == "galton" else theirs(library, n_envs)
    advance()
    advance()
    while pipe.recv():
        start, n = time.perf_counter(), 0
        while n < 3 or time.perf_counter() - start < 3:
            advance()
            n += 1
        pipe.send(n * STEPS / (time.perf_counter() - start))


def main():
    from galton.saving.provenance import versions

    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--rounds", type=int, default=5)
    parser.add_argument("--out", type=Path, default=Path("results/benchmarks/one_run.json"))
    options = parser.parse_args()
    context, found = multiprocessing.get_context("spawn"), {}
    keys = [(name, n_envs) for n_envs in (1, 8) for name in SIDES]
    pipes, processes = {}, []
    for key in keys:
        pipes[key], other = context.Pipe()
        processes.append(context.Process(target=work, args=(other, *key), daemon=True))
        processes[-1].start()
    for _ in range(options.rounds):
        for key in keys:
            pipes[key].send(True)
            found.setdefault(key, []).append(pipes[key].recv())
    for pipe, process in zip(pipes.values(), processes, strict=True):
        pipe.send(False)
        process.join()
    cpu = [line for line in Path("/proc/cpuinfo").read_text().splitlines() if line.startswith("model name")]
    record = {
        "measured": datetime.datetime.now(datetime.UTC).date().isoformat(),
        "cores": os.cpu_count(),
        "machine": cpu[0].split(":")[1].strip() if cpu else platform.machine(),
        "versions": versions("jax", "mujoco", "sbx-rl", "stable-baselines3"),
        "rows": [
            {
                "side": name,
                "n_envs": n,
                "steps_per_second": round(statistics.median(found[name, n])),
                "rounds": found[name, n],
            }
            for name, n in keys
        ],
    }
    options.out.write_text(json.dumps(record, indent=2) + "\n")
    for name in SIDES:
        print(f"| {name} | " + " | ".join(f"{statistics.median(found[name, n]):,.0f}" for n in (1, 8)) + " |")


if __name__ == "__main__":
    main()
