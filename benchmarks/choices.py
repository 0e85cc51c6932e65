"""Choices beside numbers: what they learn, beside Stable-Baselines3's PPO, a known optimum, and the threshold trick.

- `cartpole`, `lunar-lander`: Galton's PPO and SB3's with the same numbers, on fresh seeds.
- `bandit`: a number and a choice among five whose best value depends on the observation; the optimum is 1.
- `picker`: reach a ball with two motors and shut a gripper exactly near it: numbers beside a choice, under a Gaussian
  and over bins, and the usual trick, a third number that shuts the gripper above 0; the Gaussian's with a bonus of
  entropy too, since a choice that is made early is hardly tried again.
- `gears`: the best of 7 gears follows the load; with and without an order of their values.

Each line is kept as it ends, so the command goes on where it stopped, and then prints the tables.

    python benchmarks/choices.py [--parts bandit ...] [--out results/benchmarks/choices.jsonl]
"""

import argparse
import dataclasses
import json
import math
import multiprocessing
import os
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np
from gymnasium.spaces import Box, Dict, Discrete

import galton
from galton_experiments.analysis.statistics import mean_interval

FRESH = tuple(range(4000, 4005))
MANY = tuple(range(4000, 4020))


@dataclasses.dataclass(frozen=True)
class Shared:
    """What the small tasks have alike."""

    observation_low, observation_high = np.full(1, -1, np.float32), np.ones(1, np.float32)
    max_episode_steps = 1
    optimal_return = random_return = None

    def noise(self, key):
        del key
        return ()


@dataclasses.dataclass(frozen=True)
class Bandit(Shared):
    """r = ½ (1 − (a − s)²/4) + ½ [choice is right]; the right one of five is where s lies."""

    action_space = Dict(number=Box(-1, 1, (1,)), choice=Discrete(5))
    optimal_return = 1.0

    def reset(self, key):
        return jax.random.uniform(key, (1,), minval=-1.0)

    def step(self, state, action, noise):
        del noise
        right = jnp.minimum((2.5 * (state[0] + 1)).astype(int), 4)
        near = 1 - (action["number"][0] - state[0]) ** 2 / 4
        return state, 0.5 * near + 0.5 * (action["choice"] == right), jnp.array(True)

    def observe(self, state):
        return state


@dataclasses.dataclass(frozen=True)
class Gears(Shared):
    """r = 1 − (gear − best)² / 8 with the best of 7 gears, 3 (s + 1) rounded: a random choice earns about 0."""

    action_space = Discrete(7)
    optimal_return = 1.0

    def reset(self, key):
        return jax.random.uniform(key, (1,), minval=-1.0)

    def step(self, state, action, noise):
        del noise
        return state, 1 - (action - jnp.rint(3 * (state[0] + 1))) ** 2 / 8, jnp.array(True)

    def observe(self, state):
        return state


@dataclasses.dataclass(frozen=True)
class Picker:
    """Two motors move a hand towards a ball; each step earns 1 if the gripper is shut exactly near it, less the way."""

    trick: bool = False
    """The gripper is a number, and shut above 0."""

    observation_low, observation_high = np.full(5, -1, np.float32), np.ones(5, np.float32)
    max_episode_steps = 30
    optimal_return = random_return = None

    @property
    def action_space(self):
        motors = Box(-1, 1, (2,))
        return Dict(motors=motors, gripper=Box(-1, 1, (1,)) if self.trick else Discrete(2))

    def reset(self, key):
        return jnp.append(jax.random.uniform(key, (4,), minval=-1.0), 0.0)

    def noise(self, key):
        del key
        return ()

    def step(self, state, action, noise):
        del noise
        hand, ball = jnp.clip(state[:2] + 0.2 * action["motors"], -1, 1), state[2:4]
        distance = jnp.linalg.norm(hand - ball)
        shut = action["gripper"][0] > 0 if self.trick else action["gripper"] == 1
        reward = (shut == (distance < 0.3)) - distance
        return jnp.concatenate([hand, ball, state[4:] + 1]), reward.astype(float), jnp.array(False)

    def observe(self, state):
        return jnp.append(state[:4], state[4] / 15 - 1)


PPO = {"algorithm": "ppo", "n_envs": 8, "n_steps": 32, "n_epochs": 10}
LANDER = {"n_envs": 8, "n_steps": 256, "n_epochs": 10, "gamma": 0.999, "gae_lambda": 0.98, "ent_coef": 0.01}
BINS = {"loss": "hl-gauss-centred", "n_bins": 21, "eta": 1.0, "bin_centers": "bounds", "target_tails": "reflected"}
BINS |= {"deterministic_action": "mean"}
HEADS = {
    "a Gaussian and a choice": {"loss": "gaussian", "log_std_init": -0.5},
    "bins and a choice": BINS | {"head_scale": 4.0},
}
LONG = PPO | {"n_steps": 256}
ORDERS = {"ordered": {"ordered": ("0",)}, "not ordered": {}}
JOBS = {
    "cartpole": {"Galton": ("CartPole-v1", PPO | {"loss": "hl-one-hot"}, 100_000, FRESH)},
    "lunar-lander": {"Galton": ("LunarLander-v3", PPO | LANDER | {"loss": "hl-one-hot"}, 500_000, FRESH)},
    "bandit": {name: (Bandit(), PPO | head, 100_000, MANY) for name, head in HEADS.items()},
    "picker": {name: (Picker(), LONG | head, 300_000, MANY) for name, head in HEADS.items()},
    "gears": {name: (Gears(), PPO | BINS | order, 10_240, MANY) for name, order in ORDERS.items()},
}
JOBS["picker"] |= {
    f"{name.split(' and')[0]}, shut above 0": (Picker(trick=True), LONG | head, 300_000, MANY)
    for name, head in HEADS.items()
}
JOBS["picker"] |= {
    f"{name}, entropy .01": (task, words | {"ent_coef": 0.01}, steps, seeds)
    for name, (task, words, steps, seeds) in list(JOBS["picker"].items())
    if "Gaussian" in name
}
JOBS["gears"] |= {
    f"{name}, × 4": (Gears(), PPO | BINS | order | {"head_scale": 4.0}, 10_240, MANY) for name, order in ORDERS.items()
}
"""Of each part, by method: the task, the agent's settings, environment steps and seeds."""
THEIRS = {"cartpole": ("CartPole-v1", PPO, 100_000), "lunar-lander": ("LunarLander-v3", PPO | LANDER, 500_000)}


def ours(part, method):
    """Train all seeds side by side: returns of the deterministic policy at 40 points, for gears 256 steps apart."""
    task, words, steps, seeds = JOBS[part][method]
    result = galton.train(task, galton.make_agent(**words), seeds, steps, n_logs=40, n_eval_episodes=20)
    return {"steps": np.asarray(result.steps).tolist(), "curves": np.asarray(result.log.evaluation_return).tolist()}


def theirs(part):
    """SB3's PPO with the same numbers, seed after seed: the deterministic policy's mean of 20 episodes at the end."""
    import stable_baselines3
    import torch
    from stable_baselines3.common.env_util import make_vec_env
    from stable_baselines3.common.evaluation import evaluate_policy

    torch.set_num_threads(1)
    env, words, steps = THEIRS[part]
    numbers = {name: value for name, value in words.items() if name not in ("algorithm", "n_envs")}
    found = []
    for seed in FRESH:
        model = stable_baselines3.PPO(
            "MlpPolicy", make_vec_env(env, words["n_envs"], seed=seed), seed=seed, device="cpu", **numbers
        )
        model.learn(steps)
        mean, _ = evaluate_policy(model, make_vec_env(env, 1, seed=10_000 + seed), 20)
        found.append([float(mean)])
    return {"steps": [steps], "curves": found}


def job(arguments):
    """Do one, and write it down."""
    out, part, method = arguments
    galton.use_all_cores()
    line = {"part": part, "method": method} | (theirs(part) if method == "SB3" else ours(part, method))
    with out.open("a") as file:
        file.write(json.dumps(line | {"version": galton.__version__}) + "\n")


def read(out):
    """The lines that are there, by part and method."""
    lines = map(json.loads, out.read_text().splitlines()) if out.exists() else ()
    return {(line["part"], line["method"]): line for line in lines}


def first_at(line, wanted):
    """The environment steps after which each run's return was first at least that; infinite where it never was."""
    steps = np.array([*line["steps"], math.inf])
    above = np.array(line["curves"]) >= wanted
    return steps[np.where(above.any(1), above.argmax(1), len(steps) - 1)]


def tables(done):
    """Markdown's lines: final returns with 95% intervals over seeds, and of the gears the steps to 90%."""
    yield "| part | method | seeds | return |\n|---|---|---|---|"
    for (part, method), line in sorted(done.items()):
        finals = np.array(line["curves"])[:, -1]
        told = f"{mean_interval(finals):{',.1f' if np.ptp(finals) > 5 else '.3f'}}"
        yield f"| {part} | {method} | {len(finals)} | {told} |"
    yield "\n| gears | steps to 0.9 of the optimum, median | of 20 runs that got there |\n|---|---|---|"
    for (part, method), line in sorted(done.items()):
        if part == "gears":
            took = first_at(line, 0.9)
            yield f"| {method} | {np.median(took):,.0f} | {np.isfinite(took).sum()} |"


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--parts", nargs="+", default=[*JOBS], choices=[*JOBS])
    parser.add_argument("--processes", type=int, default=os.cpu_count())
    parser.add_argument("--out", type=Path, default=Path("results/benchmarks/choices.jsonl"))
    arguments = parser.parse_args()
    known = read(arguments.out)
    jobs = [(part, method) for part in arguments.parts for method in (*JOBS[part], *(["SB3"] * (part in THEIRS)))]
    jobs = [(arguments.out, *one) for one in jobs if one not in known]
    arguments.out.parent.mkdir(parents=True, exist_ok=True)
    with multiprocessing.get_context("spawn").Pool(arguments.processes, maxtasksperchild=1) as pool:
        pool.map(job, jobs, chunksize=1)
    print(*tables(read(arguments.out)), sep="\n")


if __name__ == "__main__":
    main()
