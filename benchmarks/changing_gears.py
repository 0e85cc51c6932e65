"""Which head comes back where a robot's gears are reversed, and does it help that statistics forget?

PPO on HalfCheetah, whose gears are × −1 and back after each 48 updates of 8 · 256 steps, 98,304; a run has four such
phases. The numbers are those of the preset "gaussian", set by hand before on the robot that stays, but for the decay of
the learning rate, of which there is none. Observations and rewards are normalised by statistics of all that was seen or
of a window of 20,480 steps. The control of each head is the robot that stays, with all that was seen. Each has the same
three fresh seeds.

Told is the deterministic policy's return, of two episodes at every fourth update. A run is back where that is 500,
which two Gaussians of other seeds passed in each of their first two phases.

    python benchmarks/changing_gears.py [--out results/benchmarks/changing_gears.json]   # goes on from what is there
"""

import functools
import math

import gymnasium
import numpy as np
from kept import interval, study

import galton
from galton.presets import PRESETS
from galton.training.population import populate
from galton_experiments.analysis import phases, recoveries

SEEDS = range(9000, 9003)
PHASES, LOGS, UPDATES, BACK = 4, 12, 4, 500.0
"""Phases of a run, log points in each, updates from one to the next, and the return that counts as back."""
PERIOD = LOGS * UPDATES * 256
"""Steps of a copy from one change to the next."""

PPO = {"algorithm": "ppo"} | PRESETS["gaussian"]["ppo"].settings | {"decay_steps": 0.0}
BINS = {"n_bins": 41, "bin_centers": "bounds", "deterministic_action": "mean"}
HEADS = {
    "Gaussian": {"loss": "gaussian"},
    "centred HL-Gauss": BINS
    | {"loss": "hl-gauss-centred", "eta": 4.0, "target_tails": "reflected", "initial_policy": "clipped-gaussian"}
    | {"head_scale": 4.0},
    "discretised Gaussian": BINS | {"loss": "hl-one-hot", "policy": "discretised-gaussian"},
}
"""As in benchmarks/heads.toml."""
WINDOWS = {"all": math.inf, "window": 20_480.0}
"""The steps that statistics count for."""
TASKS = {"reversed": (PERIOD, ("all", "window")), "stays": (10**9, ("all",))}
"""Steps of a copy until a change, and the statistics."""


def judged(head, task):
    """The entries of the file for a head on a task, by the statistics."""
    period, windows = TASKS[task]
    each = np.repeat([WINDOWS[window] for window in windows], len(SEEDS))
    agent = galton.make_agent(**PPO | HEADS[head], normalize_window=each)
    env = functools.partial(gymnasium.make, "galton/HalfCheetahGears-v0", period=period)
    population, returns = populate(env, agent, [*SEEDS] * len(windows)), []
    for _ in range(PHASES * LOGS):
        population.advance(UPDATES)
        returns.append(population.evaluate(2).mean(1))
    diverged = np.split(population.diverged_at >= 0, len(windows))
    groups = zip(windows, np.split(np.stack(returns, 1), len(windows)), diverged, strict=True)
    return {window: told(returns, int(lost.sum())) for window, returns, lost in groups}


def told(returns, diverged):
    """Returns of each run and phase, and the updates of those that came back after each change."""
    steps = np.arange(1, PHASES * LOGS + 1) * UPDATES * 256
    times = recoveries(returns, steps, PERIOD, BACK)
    return {
        "returns": returns.round(1).tolist(),
        "phases": np.round([phase.mean(1) for phase in phases(returns, steps, PERIOD)], 1).tolist(),
        "never_back": [len(each._right) for each in times],
        "updates_until_back": [(each._uncensored // 256).tolist() for each in times],
        "diverged": diverged,
    }


def tell(entry):
    """The mean return of each phase, and how many were not back after each change."""
    return " | ".join(
        f"{window}: {', '.join(interval(phase, 0) for phase in of['phases'])}; {of['never_back']}"
        for window, of in entry.items()
    )


def main():
    jobs = {(head, task): functools.partial(judged, head, task) for task in TASKS for head in HEADS}
    galton.use_all_cores()
    study(__doc__, "changing_gears", jobs, tell)


if __name__ == "__main__":
    main()
