"""The distribution in SB3's and rsl_rl's PPO: what it learns and costs, beside their Gaussians and Galton's PPO.

The numbers are the same everywhere: of Pendulum 4 × 512 steps, γ .9, rate 1e-3, 40,960 steps; of HalfCheetah 8 × 256
steps, rate 3e-4, 300,000 steps; ten epochs of minibatches of 64, observations and rewards normalised, k = 41, η = 2.
The deterministic policy plays 20 episodes in the end. Each line is kept as it ends, so the command goes on where it
stopped, and then prints the table.

    python benchmarks/in_torch.py [--tasks Pendulum-v1] [--seeds 3] [--out results/benchmarks/in_torch.jsonl]
    .venv-others/bin/python benchmarks/in_torch.py --library rsl_rl

rsl_rl needs the environment of `make test-others`. It has no normalisation of rewards, so they are normalised outside.

With --cost it measures instead how long an update takes, with the distribution and with SB3's Gaussian in turn.
"""

import argparse
import contextlib
import io
import itertools
import json
import multiprocessing
import os
import statistics
import time
from pathlib import Path

import numpy as np

import galton

TASKS = {
    "Pendulum-v1": ({"n_envs": 4, "n_steps": 512, "gamma": 0.9, "learning_rate": 1e-3}, 40_960),
    "HalfCheetah-v5": ({"n_envs": 8, "n_steps": 256, "gamma": 0.99, "learning_rate": 3e-4}, 300_000),
}
FIRST_SEED, N_EPISODES, K, ETA = 5000, 20, 41, 2.0
LOSSES = ("hl-gauss-centred", "hl-one-hot")
LIBRARIES = ("SB3", "rsl_rl", "Galton")
METHODS = tuple(f"{library}, {loss}" for library in LIBRARIES for loss in ("Gaussian", *LOSSES))


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
    loss = method.partition(", ")[2]
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


class Copies:
    """Gymnasium's copies of a task as rsl_rl steps environments, with actions cut off at the box."""

    device, cfg = "cpu", {}

    def __init__(self, task, n, gamma, seed):
        import gymnasium
        import torch
        from gymnasium.wrappers.vector import NormalizeReward

        self.torch, self.num_envs = torch, n
        kept = {"autoreset_mode": gymnasium.vector.AutoresetMode.SAME_STEP}
        copies = gymnasium.make_vec(task, n, vectorization_mode="sync", vector_kwargs=kept)
        self.env = NormalizeReward(copies, gamma)
        self.low, self.high = copies.single_action_space.low, copies.single_action_space.high
        self.num_actions, self.max_episode_length = len(self.low), copies.spec.max_episode_steps
        self.episode_length_buf = torch.zeros(n, dtype=torch.long)
        self.observation = self.env.reset(seed=seed)[0]

    def get_observations(self):
        from tensordict import TensorDict

        seen = self.torch.as_tensor(self.observation, dtype=self.torch.float32)
        return TensorDict({"policy": seen}, batch_size=[len(seen)])

    def step(self, actions):
        cut = np.clip(actions.numpy(), self.low, self.high)
        self.observation, reward, ended, cut_off, _ = self.env.step(cut)
        done = self.torch.as_tensor(ended | cut_off)
        told = {"time_outs": self.torch.as_tensor(cut_off & ~ended)}
        return self.get_observations(), self.torch.as_tensor(reward, dtype=self.torch.float32), done, told


def in_rsl_rl(task, method, seed):
    """The return after training rsl_rl's PPO with the same numbers, its rate fixed."""
    import gymnasium
    import torch
    from rsl_rl.runners import OnPolicyRunner

    torch.set_num_threads(1)
    torch.manual_seed(seed)
    words, steps = TASKS[task]
    env = Copies(task, words["n_envs"], words["gamma"], seed)
    loss = method.partition(", ")[2]
    low, high = env.low.tolist(), env.high.tolist()
    distribution = {"class_name": "GaussianDistribution", "init_std": 1.0, "std_type": "log"}
    if loss != "Gaussian":
        distribution = {"class_name": "galton.torch.rsl_rl:Histogram", "loss": loss, "n_bins": K, "eta": ETA}
        distribution |= {"low": low, "high": high}
    body = {"class_name": "MLPModel", "hidden_dims": [64, 64], "activation": "tanh", "obs_normalization": True}
    algorithm = {"class_name": "PPO", "learning_rate": words["learning_rate"], "schedule": "fixed"}
    algorithm |= {"gamma": words["gamma"], "entropy_coef": 0.0, "value_loss_coef": 0.5, "max_grad_norm": 0.5}
    algorithm |= {"use_clipped_value_loss": False, "normalize_advantage_per_mini_batch": True}
    size = words["n_envs"] * words["n_steps"]
    algorithm |= {"num_learning_epochs": 10, "num_mini_batches": size // 64}
    runner = OnPolicyRunner(
        env,
        {
            "num_steps_per_env": words["n_steps"],
            "save_interval": 10**6,
            "obs_groups": {"actor": ["policy"], "critic": ["policy"]},
            "algorithm": algorithm,
            "actor": body | {"distribution_cfg": distribution},
            "critic": dict(body),
            "multi_gpu": None,
        },
    )
    with contextlib.redirect_stdout(io.StringIO()):
        runner.learn(-(-steps // size))
    act, test = runner.get_inference_policy(), gymnasium.make(task)
    returns = []
    for i in range(N_EPISODES):
        env.observation, total, over = test.reset(seed=10_000 + seed if i == 0 else None)[0][None], 0.0, False
        while not over:
            with torch.no_grad():
                action = act(env.get_observations()).numpy()[0]
            seen, reward, ended, cut_off, _ = test.step(np.clip(action, env.low, env.high))
            env.observation, total, over = seen[None], total + reward, ended or cut_off
        returns.append(total)
    return float(np.mean(returns))


def ours(task, method, seed):
    """The return after training Galton's PPO."""
    words, steps = TASKS[task]
    loss = method.partition(", ")[2].lower()
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
    found = {"SB3": theirs, "rsl_rl": in_rsl_rl, "Galton": ours}[method.partition(",")[0]](task, method, seed)
    line = {"task": task, "method": method, "seed": seed, "return": round(found, 3)}
    with out.open("a") as file:
        file.write(json.dumps(line | {"seconds": round(time.perf_counter() - start, 1)}) + "\n")


def read(out):
    """The lines that are there."""
    return list(map(json.loads, out.read_text().splitlines())) if out.exists() else []


def table(lines):
    """Markdown's lines: mean returns with 95% intervals over seeds."""
    from galton_experiments.analysis.statistics import mean_interval

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
    parser.add_argument("--library", choices=LIBRARIES, help="this one alone; else SB3 and Galton")
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
    libraries = [arguments.library] if arguments.library else ["SB3", "Galton"]
    methods = [method for method in METHODS if method.partition(",")[0] in libraries]
    jobs = [one for one in itertools.product(arguments.tasks, methods, seeds) if one not in known]
    with multiprocessing.get_context("spawn").Pool(arguments.processes, maxtasksperchild=1) as pool:
        pool.map(job, [(arguments.out, *one) for one in jobs], chunksize=1)
    if arguments.library != "rsl_rl":  # whose environment lacks the statistics
        print(*table(read(arguments.out)), sep="\n")


if __name__ == "__main__":
    main()
