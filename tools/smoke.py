"""An installed wheel is tried: the least that each extra is for, and the line that names a missing one."""

import re
import sys
import time
from typing import NamedTuple

from builds import ROOT
from environments import Environment


class Call(NamedTuple):
    """A command, and how it must end."""

    words: str | tuple[str, ...]
    says: str
    """A regular expression that its output, both streams, must contain."""
    code: int = 0


TINY = "--steps 400 --logs 2 --eval-episodes 1 --net-arch 4"
SWEEP = f"--trials 2 --workers 1 {TINY}"
GRID = """
from pathlib import Path
Path("grid.toml").write_text('[[grid]]\\nloss = ["gaussian"]\\nlearning_rate = [0.01, 0.1]\\n')
"""
MODEL = """
import galton, numpy
model = galton.A2C("Pendulum-v1", n_bins=5, net_arch=(4,))
model.learn(40, progress_bar=False)
model.save("model.safetensors")
again = galton.A2C.load("model.safetensors")
state = numpy.zeros(3, numpy.float32)
assert (model.predict(state, deterministic=True)[0] == again.predict(state, deterministic=True)[0]).all()
import sys
heavy = "pyarrow matplotlib jinja2 tensorboardX fsspec".split()
print([name for name in heavy if name in sys.modules])
"""
BENCHMARK = """
from pathlib import Path
Path("smoke.toml").write_text('''
title = "Smoke"
seed = 0
baseline = "gaussian"
budget = { settings = 2, seeds = 2, fresh_seeds = 2, steps = 400, logs = 2, eval_episodes = 1 }
fixed = { algorithm = "a2c", net_arch = [4], n_bins = 5 }
prior = { learning_rate = { choice = [0.01, 0.1] } }
methods = { gaussian = { fixed = { loss = "gaussian" } }, bins = { fixed = { loss = "hl-one-hot" } } }
tasks = { bandit = { env = "bandit" } }
''')
"""
WANDB = """
import galton
call = galton.callbacks.WeightsAndBiases(mode="offline", project="smoke")
galton.A2C("bandit", n_bins=5).learn(200, callback=call, progress_bar=False)
call.run.finish()
"""
DASK = """
import subprocess, sys, distributed
with distributed.LocalCluster(n_workers=1, threads_per_worker=1, dashboard_address=None) as cluster:
    words = sys.argv[1].split()
    sys.exit(subprocess.run(["galton", "sweep", "bandit", "--scheduler", cluster.scheduler_address, *words]).returncode)
"""

TRAIN = Call(f"galton train bandit --out run --tensorboard {TINY}", "run folder: run")
CORE = [
    Call("galton --version", r"^\d+\.\d+"),
    Call(("python", "-c", MODEL), r"\[\]"),
    TRAIN,
    Call(f"galton train bandit --out run --resume {TINY} --steps 4000", "run folder: run"),
    Call("galton export run --format card", "card: run/model_card.md"),
    Call("galton check Pendulum-v1", "it can be trained on"),
]
EXPERIMENTS = [
    Call(
        f"galton compare bandit --losses gaussian hl-gauss --seeds 2 {TINY}", "figure and numbers: runs/compare-bandit"
    ),
    Call(("python", "-c", GRID), ""),
    Call(f"galton sweep bandit --grid grid.toml {SWEEP} --out sweep", "sweep"),
    Call("galton sweep status sweep", "done"),
    Call(("python", "-c", BENCHMARK), ""),
    Call("galton benchmark smoke.toml --out smoke --workers 1", "report: smoke/index.html"),
]

SMOKE = {
    "experiments": EXPERIMENTS,
    "mujoco": [Call(f"galton train Reacher-v5 --out reacher {TINY}", "run folder: reacher")],
    "box2d": [Call(f"galton train LunarLanderContinuous-v3 --out lander {TINY}", "run folder: lander")],
    "video": [
        Call(f"galton train Pendulum-v1 --out pendulum {TINY}", "run folder: pendulum"),
        Call("galton watch pendulum --max-steps 5", "video: pendulum/video.mp4"),
        Call("galton watch pendulum --max-steps 5 --out pendulum.gif", "video: pendulum.gif"),
    ],
    "onnx": [Call("galton export run --format onnx", "contract: run/policy.json")],
    "wandb": [Call(("python", "-c", WANDB), r"rollout/ep_rew_mean +-?\d")],
    "cluster": [
        Call(("python", "-c", GRID), ""),
        Call(("python", "-c", DASK, f"--grid grid.toml --trials 2 --out dask {TINY}"), "dask"),
    ],
}
"""By extra."""

TORCH = "torch", "numpy", "jaxtyping", "lazy-loader", "gymnasium"
"""The packages that `galton.torch` needs: the wheel is installed beside them without what it depends on otherwise."""
TRAINED_IN_TORCH = Call(("python", "-c", (ROOT / "tests" / "torch" / "alone.py").read_text()), "trained and exported")

MISSING = [
    Call("galton compare bandit", r"^galton: compare needs .*: pip install .*\[experiments\]'$", 2),
    Call("galton sweep bandit", r"^galton: sweep needs .*: pip install .*\[experiments\]'$", 2),
    Call("galton watch run", r"^galton: .* needs imageio_ffmpeg: pip install .*\[video\]'$", 2),
    Call("galton train Reacher-v5", r"^galton: .* needs mujoco and imageio: pip install .*\[mujoco\]'$", 2),
    Call("galton benchmark my.toml", r"^galton: benchmark needs .*: pip install .*\[experiments\]'$", 2),
    Call("galton train LunarLanderContinuous-v3", r"^galton: .* needs Box2D: pip install .*\[box2d\]'$", 2),
    Call("galton export run --format onnx", r"^galton: .* needs onnx: pip install .*\[onnx\]'$", 2),
]
"""Calls that ask for an extra, with what the core alone answers."""


def check(environment: Environment, calls: list[Call], programs: str) -> float:
    """Make these calls one after the other, and return the seconds that they took.

    Args:
        environment: where.
        calls: what, and what must come of it.
        programs: a folder for compiled programs, which environments share.

    Raises:
        SystemExit: one ended otherwise; its words are shown.
    """
    start = time.monotonic()
    more = {
        "GALTON_PROGRAMS": programs,
        "JAX_DISABLE_MOST_OPTIMIZATIONS": "1",  # nearly all of the time goes into compiling
        "HF_ENDPOINT": "http://127.0.0.1:9",
        "HF_TOKEN": "none",
    }
    for call in calls:
        words = call.words.split() if isinstance(call.words, str) else call.words
        done = environment.run(*words, **more)
        said = done.stdout + done.stderr
        if done.returncode != call.code or not re.search(call.says, said, re.MULTILINE):
            sys.exit(f"{' '.join(words)}\nended with {done.returncode}, not {call.code} and {call.says!r}:\n{said}")
    return time.monotonic() - start
