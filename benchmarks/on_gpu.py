"""Measure how fast Galton trains on a GPU, and how long its programs take to compile there.

Each stage runs in a process of its own, which is ended when its share of the time is over; the next one goes on. Every
row is in the file as soon as it is measured, so the script may be cut at any time. It needs no network.

- `a2c`: populations of 1 to 16,384 runs on the four analytic tasks, App. C.2's settings, k = 100.
- `ppo`: populations under PPO, rollouts of 8 × 256 steps, 5 epochs of minibatches of 64, k = 50.
- `copies`: one run with thousands of copies of an LQR of a cheetah's size (17 states, 6 actions), 128×128 networks.
- `compile`: four runs of 2,048 copies and rollouts of 480 steps, without XLA's autotuning of fusions; and once more
  with it at the end, in all the time that is left.
- `compile-counting`: the first of these programs as it was when `Bins.encode` counted edges; only where it is named.
- `precision`: A2C with matrix products in float32, and in TF32.

    python benchmarks/on_gpu.py [--seconds 480] [--toy] [--stages a2c ppo ...] [--out results/benchmarks]

`--toy` makes sizes small enough for a CPU. Results are named after the device: on_gpu_<device>.json.
"""

import argparse
import datetime
import json
import math
import os
import statistics
import subprocess
import sys
import threading
import time
from pathlib import Path

import numpy as np

UNTUNED = "--xla_gpu_experimental_enable_fusion_autotuner=false"
TASKS = ("mountain-car", "lqr", "acrobot", "bandit")
STAGES = {
    "a2c": ("", 0.36),
    "compile": (UNTUNED, 0.14),
    "ppo": ("", 0.16),
    "copies": ("", 0.12),
    "precision": ("", 0.06),
    "compile-autotuned": ("", 0.16),
    "compile-counting": ("", 0.16),
}
"""The flags that XLA gets, and the share of the time. What one leaves over goes to those after it."""


def a2c(sizes):
    """The largest populations first, then how speed grows with their number, then centred HL-Gauss."""
    largest = sizes[-1]
    for task in TASKS:
        for loss in ("gaussian", "hl-gauss"):
            measure("a2c", task, loss, largest)
    for runs in reversed(sizes[:-1]):
        for loss in ("gaussian", "hl-gauss"):
            measure("a2c", "mountain-car", loss, runs)
    for task in TASKS[:2]:
        measure("a2c", task, "hl-gauss-centred", largest)


def ppo(sizes):
    """From few runs to many, since a rollout of many takes long."""
    settings = {"n_envs": 8, "n_steps": 256, "n_epochs": 5, "n_bins": 50}
    for runs in (sizes[1], sizes[2], sizes[0], sizes[-1]):
        for loss in ("gaussian", "hl-gauss-centred"):
            measure("ppo", "lqr", loss, runs, **settings)
    for loss in ("gaussian", "hl-gauss-centred"):
        measure("ppo", "acrobot", loss, sizes[1], **settings)


def copies(sizes):
    """One run whose minibatches have thousands of steps."""
    for loss in ("gaussian", "hl-gauss-centred"):
        for n_envs in sizes[2:]:
            measure("ppo", cheetah_sized(), loss, 1, **large(n_envs))


def compile_(sizes):
    """Compile alone: nothing is trained."""
    for loss in ("hl-gauss-centred", "gaussian"):
        measure("ppo", cheetah_sized(), loss, sizes[1] // 16 or 1, slices=0, **large(2 * sizes[2], n_steps=480))


def counting(sizes):
    """Compile the head's program with the index that was: the number of inner edges at or below an action."""
    from galton import Bins

    Bins.encode = lambda self, action: (action[..., None] >= self.edges[:, 1:-1]).sum(-1)
    compile_(sizes)


def precision(sizes):
    """The same population with products of matrices in float32, then in TF32, then as JAX does by default."""
    import jax

    from galton.training.programs import make_room

    for name in ("highest", "tensorfloat32", None):
        jax.config.update("jax_default_matmul_precision", name)
        make_room(share=0)  # the programs of this process don't know of the precision
        measure("a2c", "lqr", "hl-gauss", sizes[-2], precision=str(name))


def large(n_envs, n_steps=30):
    """The settings that PPO has on a GPU: 4 epochs of 32 minibatches."""
    batch_size = max(1, n_envs * n_steps // 32)
    settings = {"n_envs": n_envs, "n_steps": n_steps, "n_epochs": 4, "batch_size": batch_size}
    return settings | {"n_bins": 41, "net_arch": (128, 128)}


def cheetah_sized():
    """An LQR with as many states and actions as HalfCheetah has."""
    from galton.envs.lqr import LQR

    states, actions = 17, 6
    return LQR(0.98 * np.eye(states), 0.1 * np.eye(states, actions), np.eye(states), np.eye(actions))


def measure(algorithm, env, loss, runs, slices=3, precision=None, **settings):
    """Compile, begin and train: one row, printed as a line of JSON."""
    import jax

    import galton
    from galton.training.population import populate

    agent = galton.make_agent(algorithm=algorithm, loss=loss, eta=2.0, **settings)
    row = {"algorithm": algorithm, "env": env if isinstance(env, str) else type(env).__name__.lower() + "-17x6"}
    row |= {"loss": loss, "runs": runs} | settings | ({"precision": precision} if precision else {})
    print(json.dumps({"at": row}), flush=True)
    try:
        start = time.perf_counter()
        population = populate(env, agent, range(runs), jax.devices()[:1])
        population.compile()
        _ = population.learner  # fetched, so what begins the runs is done
        row["compile_seconds"] = population.compile_seconds
        row["begin_seconds"] = time.perf_counter() - start - population.compile_seconds
        if slices:
            row |= speed(population, runs * agent.rollout.size, slices)
        population.close()
    except Exception as error:  # one size too large must not end the others
        row["error"] = f"{type(error).__name__}: {str(error)[:300]}"
    print(json.dumps(row), flush=True)


def speed(population, batch, slices):
    """Environment steps a second in slices of half a second or more, after a first one that is not counted."""
    updates, seconds = 1, 0.0
    while seconds < 0.5:
        updates = max(updates, math.ceil(updates * 0.7 / seconds)) if seconds else 1
        start = time.perf_counter()
        population.advance(updates)
        seconds = time.perf_counter() - start
        if updates == 1 and seconds > 3:
            break
    rates = []
    for _ in range(slices):
        start = time.perf_counter()
        population.advance(updates)
        rates.append(updates * batch / (time.perf_counter() - start))
    return {"steps_per_second": statistics.median(rates), "slices": rates}


def stage(name, toy):
    """Run one stage, in a process of its own."""
    import jax

    device = jax.devices()[0]
    print(json.dumps({"device": device.device_kind, "platform": device.platform, "jax": jax.__version__}), flush=True)
    sizes = (1, 4, 16) if toy else (1, 64, 1024, 4096, 16384)
    stages = {"a2c": a2c, "ppo": ppo, "copies": copies, "precision": precision, "compile-counting": counting}
    stages.get(name, compile_)(sizes)


def run(name, seconds, toy, flags, note):
    """Run a stage for so long at most, and hand on each of its rows."""
    command = [sys.executable, __file__, "--stage", name, *(["--toy"] if toy else [])]
    environment = os.environ | {"XLA_FLAGS": f"{os.environ.get('XLA_FLAGS', '')} {flags}".strip()}
    process = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, env=environment)
    alarms = []
    reader = threading.Thread(target=lambda: alarms.extend(process.stderr), daemon=True)
    reader.start()
    timer = threading.Timer(seconds, process.kill)
    timer.start()
    start, at = time.perf_counter(), None
    for line in process.stdout:
        row = json.loads(line)
        at = row.get("at")
        if at is None:
            note(row)
    status = process.wait()
    timer.cancel()
    reader.join(5)
    ended = {"status": status, "seconds": time.perf_counter() - start} | ({"cut_off_at": at} if at else {})
    slow = [line.strip() for line in alarms if "slow" in line.lower() and "compil" in line.lower()]
    tail = [line.rstrip() for line in alarms[-12:]] if status not in (0, -9) else []
    return ended | ({"slow": slow[:5]} if slow else {}) | ({"last_lines": tail} if tail else {})


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seconds", type=float, default=480)
    parser.add_argument("--toy", action="store_true")
    parser.add_argument(
        "--stages", nargs="+", choices=list(STAGES), default=[name for name in STAGES if name != "compile-counting"]
    )
    parser.add_argument("--out", type=Path, default=Path("results/benchmarks"))
    parser.add_argument("--stage", help=argparse.SUPPRESS)
    arguments = parser.parse_args()
    if arguments.stage:
        stage(arguments.stage, arguments.toy)
        return

    today = datetime.datetime.now(datetime.UTC).date().isoformat()
    found = {"measured": today, "toy": arguments.toy, "stages": {}}
    arguments.out.mkdir(parents=True, exist_ok=True)

    def note(row, rows):
        if "device" in row:
            found.update(row)
        else:
            rows.append(row)
            shown = {key: f"{value:,.1f}" if isinstance(value, float) else value for key, value in row.items()}
            print({key: value for key, value in shown.items() if key != "slices"}, flush=True)
        save()

    def save():
        name = "".join(c if c.isalnum() else "-" for c in found.get("device", "nothing").lower())
        path = arguments.out / f"on_gpu_{name}.json"
        path.with_suffix(".part").write_text(json.dumps(found, indent=1) + "\n")
        path.with_suffix(".part").replace(path)

    end = time.perf_counter() + arguments.seconds
    shares = sum(STAGES[name][1] for name in arguments.stages)
    for name in arguments.stages:
        flags, share = STAGES[name]
        seconds, shares = (end - time.perf_counter()) * share / shares, shares - share
        print(f"{name}: {seconds:.0f} s", flush=True)
        rows = []
        found["stages"][name] = {"flags": flags, "rows": rows}
        found["stages"][name] |= run(name, seconds, arguments.toy, flags, lambda row, rows=rows: note(row, rows))
        save()


if __name__ == "__main__":
    main()
