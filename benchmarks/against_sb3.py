"""Environment steps per second against Stable-Baselines3's A2C, both sides in one run.

Mountain Car, 20 steps per update, one environment per run, 64×64 tanh networks, Adam; k = 100 bins. SB3's softmax
policy is its MultiDiscrete over bin centers, which is HL-1-Hot. SB3 runs with one torch thread or with all, whichever
is faster here. Sides take turns; medians over the rounds. Nothing else should be running.

    python benchmarks/against_sb3.py [--rounds 5] [--out results/benchmarks]
"""

import argparse
import statistics
import time
from pathlib import Path

import gymnasium
import torch
from rich.console import Console
from rich.table import Table
from sides import Discretised, K, write
from stable_baselines3 import A2C

import galton
from galton.devices import n_cores


class SB3:
    """One of SB3's models, trained on in slices."""

    def __init__(self, discrete, threads):
        env = gymnasium.make("MountainCarContinuous-v0")
        env = Discretised(env) if discrete else env
        self.threads = threads
        torch.set_num_threads(threads)
        self.model = A2C("MlpPolicy", env, n_steps=20, gae_lambda=1.0, use_rms_prop=False, device="cpu", seed=0)
        self.model.learn(1_000)

    def steps_per_second(self, steps=6_000):
        torch.set_num_threads(self.threads)
        start = time.perf_counter()
        self.model.learn(steps)
        return steps / (time.perf_counter() - start)


def ours(loss, runs):
    """Steps per second of all runs together, and the seconds of compiling (0 after the first time)."""
    steps = 400_000 if runs == 1 else 40_000
    agent = galton.make_agent(loss=loss, n_bins=K)
    result = galton.train(galton.envs.MountainCar(), agent, range(runs), steps, n_logs=4, n_eval_episodes=0)
    return result.steps_per_second, result.compile_seconds


def main():
    parser = argparse.ArgumentParser()
    parser.add_argument("--rounds", type=int, default=5)
    parser.add_argument("--out", type=Path, default=Path("results/benchmarks"))
    arguments = parser.parse_args()
    galton.use_all_cores()

    cores = n_cores()
    sb3 = {(d, t): SB3(d, t) for d in (False, True) for t in {1, cores}}
    settings = [(loss, runs) for runs in (1, 64) for loss in galton.LOSSES]
    compile_seconds = {setting: ours(*setting)[1] for setting in settings}
    speeds = {key: [] for key in (*sb3, *settings)}
    for _ in range(arguments.rounds):
        for key, side in sb3.items():
            speeds[key].append(side.steps_per_second())
        for setting in settings:
            speeds[setting].append(ours(*setting)[0])
    median = {key: statistics.median(values) for key, values in speeds.items()}
    theirs = {d: max(median[d, t] for t in {1, cores}) for d in (False, True)}

    rows = [
        {"side": "SB3", "loss": name, "runs": 1, "steps_per_second": theirs[d], "ratio": 1.0, "compile_seconds": None}
        for d, name in ((False, "Gaussian"), (True, "MultiDiscrete"))
    ]
    for loss, runs in settings:
        speed = median[loss, runs]
        rows.append(
            {
                "side": "Galton",
                "loss": galton.LOSSES[loss].label,
                "runs": runs,
                "steps_per_second": speed,
                "ratio": speed / theirs[loss != "gaussian"],
                "compile_seconds": compile_seconds[loss, runs],
            }
        )
    table = Table(title=f"Mountain Car, n_steps 20, k = {K}; {cores} cores, median of {arguments.rounds} rounds")
    for heading in ("", "loss", "runs", "env-steps/s", "× SB3's counterpart", "compiling"):
        table.add_column(heading, justify="left" if heading in ("", "loss") else "right")
    for row in rows:
        seconds = "—" if row["compile_seconds"] is None else f"{row['compile_seconds']:.1f} s"
        speed, ratio = f"{row['steps_per_second']:,.0f}", f"{row['ratio']:.0f}"
        table.add_row(row["side"], row["loss"], str(row["runs"]), speed, ratio, seconds)
    Console().print(table)

    rounds = {" ".join(map(str, key)): values for key, values in speeds.items()}
    write(arguments.out / "against_sb3.json", ("stable-baselines3", "torch"), rows=rows, rounds=rounds)


if __name__ == "__main__":
    main()
