"""Estimate what the whole paper costs from rates that are measured here, and rewrite its table in docs/speed.md.

Each analytic task is trained as a sweep trains it, 16 runs in each of one process per core, with an evaluation of
ten episodes every 5,000 steps (every 20 on the bandit), for each program of App. C.2. The MuJoCo tasks' rates are
those of against_physics.json: HL-Gauss at k = 100, without evaluation. Nothing else should be running.

    python benchmarks/cost.py [--out results/benchmarks]
"""

import argparse
import collections
import json
import time
from pathlib import Path

import numpy as np
from sides import write

import galton
from galton.devices import n_cores
from galton.tasks import TASKS, task_of
from galton_experiments.page import quotes
from galton_experiments.sweep.executors import Processes, one_per_core
from galton_experiments.sweep.grid import find_grid

TRIALS, RUNS, LOG_POINTS = 20, 16, 4


def seconds_per_step(env, setting):
    """Of one core, evaluation included; and the seconds of compiling."""
    galton.use_all_cores()
    task = task_of(env)
    steps = LOG_POINTS * task.total_timesteps // task.n_logs
    agent = setting.replace(learning_rate=task.learning_rate).agent
    result = galton.train(env, agent, range(RUNS), steps, n_logs=LOG_POINTS, n_eval_episodes=10)
    return result.train_seconds / (RUNS * float(result.steps[-1])), result.compile_seconds


def main():
    parser = argparse.ArgumentParser()
    parser.add_argument("--out", type=Path, default=Path("results/benchmarks"))
    arguments = parser.parse_args()
    start = time.perf_counter()
    rows = []
    with Processes(one_per_core()) as executor:
        for env in (env for env, task in TASKS.items() if task.in_jax):
            grid = find_grid("paper", env)
            programs, of_program = collections.Counter(s.program for s in grid), {s.program: s for s in grid}
            core_seconds = compile_seconds = 0.0
            for program, n_settings in programs.items():
                calls = [executor.submit(seconds_per_step, env, of_program[program]) for _ in range(n_cores())]
                rate, compiling = np.mean([call.result() for call in calls], axis=0)
                core_seconds += rate * n_settings * TRIALS * task_of(env).total_timesteps
                compile_seconds += compiling
            runs = programs.total() * TRIALS
            rows.append((env, runs, runs * task_of(env).total_timesteps, core_seconds, compile_seconds))
    physics = json.loads((arguments.out / "against_physics.json").read_text())
    for row in physics["populations"]:
        steps = 88 * TRIALS * task_of(row["task"]).total_timesteps
        rows.append((row["task"], 88 * TRIALS, steps, steps / row["training"] * physics["cores"], None))
    keys = ("env", "runs", "steps", "core_seconds", "compile_seconds")
    write(arguments.out / "cost.json", ("mujoco",), rows=[dict(zip(keys, row, strict=True)) for row in rows])
    page(json.loads((arguments.out / "cost.json").read_text()))
    print(f"measured in {time.perf_counter() - start:,.0f} s; docs/speed.md has the new table")


def page(found):
    rows = [line(row["env"], f"{row['runs']:,}", row["steps"], row["core_seconds"]) for row in found["rows"]]
    rows.append(line("all", "", *(sum(row[name] for row in found["rows"]) for name in ("steps", "core_seconds"))))
    headings = ["task", "runs", "environment steps", "2 cores", "100 Condor slots"]
    quotes.write({"the whole paper": quotes.markdown(headings, rows)}.get, ["docs/speed.md"])


def line(name, runs, steps, core_seconds):
    return [name, runs, f"{steps / 1e6:,.0f} M", span(core_seconds / 2), span(core_seconds / 100)]


def span(seconds):
    if seconds < 5_400:
        return f"{seconds / 60:,.1f} min"
    return f"{seconds / 3600:,.1f} h"


if __name__ == "__main__":
    main()
