"""The gate: heads over bins and Gaussians with the same numbers, on tasks that nobody tuned these heads for.

Every head is trained with the numbers of two anchors, five seeds on each of nine tasks, 300,000 steps. On two of the
tasks a free shape may pay: `mountain-car`, where full force goes back and forth, and `two-peaks` of this file, which
has two optima. The deterministic policy plays 20 episodes at the end. Nothing is selected. Each job, one head with one
anchor on one task, is kept as it ends, so that the command goes on where it stopped; it ends with its
tables.

    python benchmarks/gate.py [--tasks lqr ...] [--heads gaussian ...] [--out results/benchmarks/gate.jsonl]

With --critics Gaussians with other critics take the place of the heads, and gate_critics.jsonl that of gate.jsonl:
those that classify, and as their control the squared error with their range of returns and their start.

With --cost each head's speed is measured instead, on HalfCheetah with the first anchor, beside the Gaussian's: a
process per core trains 16 runs, and the heads take turns. Nothing else should be running.
"""

import argparse
import dataclasses
import itertools
import json
import math
import multiprocessing
import os
import statistics
import time
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np
from method_speed import in_turn
from sides import write

import galton
from galton.types import Positive
from galton_experiments.analysis.aggregates import improvement
from galton_experiments.analysis.statistics import Interval, mean_interval
from galton_experiments.sweep.executors import one_per_core

STEPS = 300_000
SEEDS = tuple(range(3000, 3005))


@dataclasses.dataclass(frozen=True)
class TwoPeaks:
    """One step in which each dimension of the action has a wide optimum, and on the other side a narrow, better one.

    r = (1/d) Σ_l max(.6 φ((b_l + .4) / .4), φ((b_l − .6) / .15)) with φ(x) = e^(−x²/2) and b_l = a_l times the sign of
    the observation's entry l, so that the sides change places with the state.
    """

    d: int = 3

    max_episode_steps = 1
    optimal_return = 1.0
    random_return = None

    @property
    def action_low(self):
        return np.full(self.d, -1, np.float32)

    @property
    def action_high(self):
        return np.ones(self.d, np.float32)

    observation_low, observation_high = action_low, action_high

    def reset(self, key):
        return jax.random.uniform(key, (self.d,), minval=-1.0)

    def noise(self, key):
        del key
        return ()

    def step(self, state, action, noise):
        del noise
        along = action * jnp.sign(state)
        wide, narrow = (jnp.exp(-(((along - at) / width) ** 2) / 2) for at, width in ((-0.4, 0.4), (0.6, 0.15)))
        return state, jnp.maximum(0.6 * wide, narrow).mean(), jnp.array(True)

    def observe(self, state):
        return state


class NearItsMode(galton.losses.HLOneHot):
    """HL-1-Hot and β KL(π ‖ N), N a Gaussian over bins around the policy's own likeliest bin: FAN-PPO's regulariser.

    Niu et al. (2026, arXiv 2604.01570) have it for the action tokens of robots. β and the width are ours, chosen on
    the LQR: .01 holds a policy where it begins.
    """

    beta: Positive = 1e-3
    spread: Positive = 4.0

    def regularizer(self, distribution):
        log_probs = jax.nn.log_softmax(distribution.logits)
        mode = jnp.argmax(distribution.logits, -1, keepdims=True)
        near = jax.nn.log_softmax(-(((jnp.arange(distribution.bins.n_bins) - mode) / self.spread) ** 2) / 2)
        return self.beta * (jnp.exp(log_probs) * (log_probs - near)).sum((-1, -2))


galton.LOSSES["near-its-mode"] = NearItsMode


class Standardised(galton.critics.SquaredErrorCritic):
    """The squared error with what a classifying critic has besides: its start, and returns of ±10 as ±1."""

    init_scale = galton.critics.Classifier.init_scale

    def value(self, outputs):
        return 10 * outputs[..., 0]

    def loss(self, outputs, returns):
        return (jnp.clip(returns / 10, -1, 1) - outputs[..., 0]) ** 2


galton.CRITICS["standardised"] = Standardised

TASKS = ("lqr", "acrobot", "Pendulum-v1", "HalfCheetah-v5", "Hopper-v5", "Reacher-v5", "Swimmer-v5")
TASKS += ("mountain-car", "two-peaks")
COMMON = {
    "algorithm": "ppo",
    "n_envs": 8,
    "n_steps": 256,
    "n_epochs": 10,
    "normalize_observation": True,
    "normalize_reward": True,
    "box_units": 1.0,
}
"""Stable-Baselines3's numbers for PPO, but for eight environments, normalisation and σ in units of the box."""
ANCHORS = {"sb3": {"log_std_init": 0.0}, "hand-set": {"log_std_init": -0.5, "decay_steps": math.inf}}
"""The second is the preset of the Gaussian, set by hand on HalfCheetah: its learning rate falls to 0."""
BINS = {"n_bins": 41, "bin_centers": "bounds", "deterministic_action": "mean"}
FREE = BINS | {"initial_policy": "clipped-gaussian"}
CENTRED = {"loss": "hl-gauss-centred", "eta": 2.0, "target_tails": "reflected"}
HEADS = {
    "gaussian": {"loss": "gaussian"},
    "truncated gaussian": {"loss": "gaussian", "policy": "truncated-gaussian"},
    "gaussian, mean × 4": {"loss": "gaussian", "head_scale": 4.0},
    "gaussian, σ of the state": {"loss": "gaussian", "state_dependent_std": True},
    "spline": {"loss": "gaussian", "policy": "spline", "initial_policy": "gaussian", "deterministic_action": "mean"},
    "discretised gaussian": {"loss": "hl-one-hot", "policy": "discretised-gaussian"} | BINS,
    "anchored, S = 0.1": {"loss": "hl-one-hot", "policy": "anchored", "residual_scale": 0.1} | BINS,
    "anchored, S = 1": {"loss": "hl-one-hot", "policy": "anchored", "residual_scale": 1.0} | BINS,
    "centred × 4": CENTRED | FREE | {"head_scale": 4.0},
    "centred, rate per σ": CENTRED | FREE | {"head_rate": "per-std"},
    "centred × 4, diffusion": CENTRED | FREE | {"head_scale": 4.0, "diffusion": 0.01},
    "exact × 4": {
        "loss": "hl-one-hot",
        "policy": "smoothed",
        "eta": 2.0,
        "target_tails": "reflected",
        "head_scale": 4.0,
    }
    | FREE,
    "one-hot": {"loss": "hl-one-hot"} | FREE,
    "one-hot, near its mode": {"loss": "near-its-mode"} | FREE,
    "today's": {"loss": "hl-gauss-centred", "eta": 4.48, "target_tails": "edges"} | FREE | {"n_bins": 50},
}
"""The settings that each head adds. The last is the head of the preset of classification, with an anchor's numbers."""
CRITICS = {
    "gaussian": HEADS["gaussian"],
    **{
        f"gaussian, {name} critic": {"loss": "gaussian", "critic": name}
        for name in ("standardised", "two-hot", "hl-gauss")
    },
}


def train(job):
    """Train one head with one anchor on one task, all seeds side by side on one core, and write its returns down."""
    out, task, anchor, head = job
    galton.use_all_cores()
    start = time.perf_counter()
    agent = galton.make_agent(**COMMON | ANCHORS[anchor] | (HEADS | CRITICS)[head])
    played = TwoPeaks() if task == "two-peaks" else task
    result = galton.train(played, agent, SEEDS, STEPS, n_logs=10, n_eval_episodes=20, devices=jax.devices()[:1])
    curves = np.asarray(result.log.evaluation_return)
    line = {"task": task, "anchor": anchor, "head": head, "steps": int(result.steps[-1])}
    line |= {"returns": curves[:, -1].round(4).tolist(), "curves": curves.round(3).tolist()}
    line |= {"training_returns": np.asarray(result.log.training_return)[:, -1].round(3).tolist()}
    line |= {"diverged": int((result.diverged_at >= 0).sum()), "version": galton.__version__}
    line |= {"seconds": round(time.perf_counter() - start, 1)}
    with out.open("a") as file:
        file.write(json.dumps(line) + "\n")


def cost(out, heads):
    """Measure each head's environment steps a second, and print the medians beside the Gaussian's."""
    agents = {head: galton.make_agent(**COMMON | ANCHORS["sb3"] | HEADS[head]) for head in heads}
    speeds = in_turn(agents, "HalfCheetah-v5", one_per_core(None), 5, 2048)
    write(out, ("jax", "mujoco"), steps_per_second=speeds)
    base = statistics.median(speeds["gaussian"])
    print("| head | steps a second | the Gaussian's time, times |\n|---|---|---|")
    for head, found in speeds.items():
        print(f"| {head} | {statistics.median(found):,.0f} | {base / statistics.median(found):.2f} |")


def read(out):
    """The jobs that are done, by task, anchor and head."""
    lines = [json.loads(line) for line in out.read_text().splitlines()] if out.exists() else []
    return {(line["task"], line["anchor"], line["head"]): line for line in lines}


def interval_over_tasks(differences, n_resamples=20_000):
    """The mean of paired differences `[tasks, seeds]` and its 95% interval, tasks and then their seeds drawn again."""
    rng = np.random.default_rng(0)
    n_tasks, n_seeds = differences.shape
    tasks = rng.integers(n_tasks, size=(n_resamples, n_tasks, 1))
    seeds = rng.integers(n_seeds, size=(n_resamples, n_tasks, n_seeds))
    means = differences[tasks, seeds].mean((1, 2))
    return Interval(differences.mean(), *np.quantile(means, (0.025, 0.975)))


def tables(done):
    """The lines of two tables: each head's returns by task and anchor, and all tasks together against the Gaussian.

    A head is in the second one with the tasks on which both it and the Gaussian were trained. A task's scores are its
    returns between the worst and the best run of any head there.
    """
    tasks = [task for task in TASKS if any(key[0] == task for key in done)]
    pools = {task: np.concatenate([line["returns"] for key, line in done.items() if key[0] == task]) for task in tasks}
    yield "| numbers | head | " + " | ".join(tasks) + " |"
    yield "|---" * (len(tasks) + 2) + "|"
    for anchor, head in itertools.product(ANCHORS, HEADS | CRITICS):
        found = [done.get((task, anchor, head)) for task in tasks]
        digits = [",.0f" if np.ptp(pools[task]) > 100 else ".2f" for task in tasks]
        cells = [
            f"{mean_interval(np.array(line['returns'])):{d}}" if line else "—"
            for line, d in zip(found, digits, strict=True)
        ]
        if any(found):
            yield f"| {anchor} | {head} | " + " | ".join(cells) + " |"
    yield ""
    yield "| numbers | head | tasks | score | less the Gaussian's | ahead on | P(above the Gaussian) |"
    yield "|---|---|---|---|---|---|---|"
    for anchor, head in itertools.product(ANCHORS, HEADS | CRITICS):
        both = [task for task in tasks if {(task, anchor, head), (task, anchor, "gaussian")} <= done.keys()]
        if not both:
            continue
        spread = np.array([[pools[task].min(), np.ptp(pools[task])] for task in both])[..., None]
        ours, theirs = (
            (np.array([done[task, anchor, name]["returns"] for task in both]) - spread[:, 0]) / spread[:, 1]
            for name in (head, "gaussian")
        )
        row = f"| {anchor} | {head} | {len(both)} | {ours.mean():.2f} |"
        if head == "gaussian":
            yield row + " | | |"
            continue
        difference = interval_over_tasks(ours - theirs)
        ahead = int((ours.mean(1) > theirs.mean(1)).sum())
        above = improvement(list(ours), list(theirs), n_resamples=20_000, paired=True)
        yield row + f" {difference:+.2f} | {ahead} | {above:.2f} |"


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--tasks", nargs="+", default=list(TASKS))
    parser.add_argument("--heads", nargs="+", default=list(HEADS))
    parser.add_argument("--critics", action="store_true", help="Gaussians with other critics, to gate_critics.jsonl")
    parser.add_argument("--anchors", nargs="+", default=list(ANCHORS))
    parser.add_argument("--processes", type=int, default=os.cpu_count())
    parser.add_argument("--out", type=Path, default=Path("results/benchmarks/gate.jsonl"))
    parser.add_argument("--cost", action="store_true", help="the speed of each head, to gate_cost.json beside --out")
    arguments = parser.parse_args()
    if arguments.cost:
        cost(arguments.out.with_name("gate_cost.json"), arguments.heads)
        return
    if arguments.critics:
        arguments.heads, arguments.out = list(CRITICS), arguments.out.with_name("gate_critics.jsonl")
    known = read(arguments.out)
    wanted = itertools.product(arguments.tasks, arguments.anchors, arguments.heads)
    jobs = [(arguments.out, *job) for job in wanted if job not in known]
    with multiprocessing.get_context("spawn").Pool(arguments.processes, maxtasksperchild=1) as pool:
        pool.map(train, jobs, chunksize=1)
    print(*tables(read(arguments.out)), sep="\n")


if __name__ == "__main__":
    main()
