"""Measure how fast a sweep trains: against Stable-Baselines3, rejax and the machine itself, all sides in one run.

Mountain Car, 20 steps per update, 64×64 tanh networks. Galton trains 16 runs in each of one process per core, as a
sweep does, log points included. SB3: A2C on MultiDiscrete over k = 100 bin centers (HL-1-Hot) in one process per core,
one torch thread each. rejax 0.1.3: its PPO set up as A2C, Gaussian, 128 runs under vmap with all cores, on its own
Mountain Car. The peak is XLA's product of two 1024×1024 matrices, one thread per core. Arithmetic counts the products
of the networks alone, two operations per multiplication: the actor once to act, three times to learn, the critic four
times, less the gradient of the first layers' input. Sides take turns; medians over the rounds. Nothing else should be
running.

    python benchmarks/sweep_speed.py --rejax PYTHON [--rounds 5] [--out results/benchmarks]
"""

import argparse
import statistics
import time
from pathlib import Path

from rich.console import Console
from rich.table import Table
from sides import SB3, Ours, Script, Side, write

from galton.devices import n_cores
from galton_experiments.sweep.executors import one_per_core

TASK, RUNS, UPDATES, HIDDEN = "mountain-car", 16, 250, 64
SETTINGS = {
    "gaussian": ("gaussian", 100),
    "hl-one-hot": ("hl-one-hot", 100),
    "hl-gauss": ("hl-gauss", 100),
    "hl-gauss, k = 200": ("hl-gauss", 200),
    "hl-gauss-centred": ("hl-gauss-centred", 100),
}


class Peak:
    """Floating-point operations per second of a large product of matrices, on one thread."""

    def __init__(self):
        import jax

        self.product = jax.jit(lambda a, b: a @ b)
        self.a, self.b = jax.random.normal(jax.random.key(0), (2, 1024, 1024))
        self.advance()

    def advance(self):
        for _ in range(10):
            self.product(self.a, self.b).block_until_ready()
        return 10 * 2 * 1024**3


def operations(loss, n_bins):
    """Per environment step."""
    first, second = 2 * HIDDEN, HIDDEN * HIDDEN
    actor = first + second + HIDDEN * (1 if loss == "gaussian" else n_bins)
    critic = first + second + HIDDEN
    return 2 * (4 * actor - first + 4 * critic - first)


def main():
    parser = argparse.ArgumentParser()
    parser.add_argument("--rejax", required=True, help="a Python with rejax; make bench sets one up")
    parser.add_argument("--rounds", type=int, default=5)
    parser.add_argument("--out", type=Path, default=Path("results/benchmarks"))
    arguments = parser.parse_args()

    cores = one_per_core()
    start = time.perf_counter()
    sides = {name: Side(cores, Ours, TASK, False, loss, k, RUNS, UPDATES) for name, (loss, k) in SETTINGS.items()}
    compile_seconds = (time.perf_counter() - start) / len(sides)
    sides["hl-gauss, one worker"] = Side(cores[:1], Ours, TASK, False, "hl-gauss", 100, RUNS, UPDATES)
    sides["SB3 MultiDiscrete"] = Side(cores, SB3, "MountainCarContinuous-v0", True, 6_000)
    sides["SB3 Gaussian"] = Side(cores, SB3, "MountainCarContinuous-v0", False, 6_000)
    sides["rejax"] = Script(arguments.rejax, str(Path(__file__).with_name("rejax_side.py")))
    sides["peak"] = Side(cores, Peak)
    speeds = {name: [] for name in sides}
    for _ in range(arguments.rounds):
        for name, side in sides.items():
            speeds[name].append(side.steps_per_second())
    for side in sides.values():
        side.close()
    median = {name: statistics.median(values) for name, values in speeds.items()}

    peak = median.pop("peak")
    table = Table(title=f"Mountain Car, {RUNS} runs per core; {n_cores()} cores, median of {arguments.rounds} rounds")
    for heading in ("", "env-steps/s", "GFLOP/s", "of the peak"):
        table.add_column(heading, justify="right" if heading else "left")
    rates = {}
    for name, speed in median.items():
        if name in SETTINGS:
            rates[name] = speed * operations(*SETTINGS[name])
        share = (f"{rates[name] / 1e9:.1f}", f"{rates[name] / peak:.0%}") if name in rates else ("", "")
        table.add_row(name, f"{speed:,.0f}", *share)
    table.add_row("peak", "", f"{peak / 1e9:.1f}", "100%")
    claims = {
        "HL-Gauss / SB3 MultiDiscrete, a process per core": median["hl-gauss"] / median["SB3 MultiDiscrete"],
        "Gaussian / SB3 Gaussian, a process per core": median["gaussian"] / median["SB3 Gaussian"],
        "Gaussian / rejax": median["gaussian"] / median["rejax"],
        "time of HL-Gauss at k = 200 / Gaussian": median["gaussian"] / median["hl-gauss, k = 200"],
        "HL-Gauss, all workers / one": median["hl-gauss"] / median["hl-gauss, one worker"],
        "arithmetic of HL-Gauss / peak": rates["hl-gauss"] / peak,
    }
    console = Console()
    console.print(table)
    for name, value in claims.items():
        console.print(f"{name}: {value:.2f}", highlight=False)
    console.print(f"making and compiling: {compile_seconds:.1f} s per program and worker", highlight=False)
    write(
        arguments.out / "sweep_speed.json",
        ("mujoco", "stable-baselines3", "torch"),
        claims=claims,
        steps_per_second=median,
        operations_per_second=rates,
        peak=peak,
        compile_seconds=compile_seconds,
        rounds=speeds,
    )


if __name__ == "__main__":
    main()
