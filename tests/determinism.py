"""The same few populations, trained in processes that differ, and what differs in their numbers.

`python tests/determinism.py SPEC FILE` is such a process: it trains what SPEC tells in JSON and keeps all numbers.
"""

import json
import os
import subprocess
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path

import jax
import numpy as np

import galton
from galton.agents import read

NORMALIZED = {"normalize_observation": True, "normalize_reward": True}
CASES = {
    "bandit": ("bandit", 2_000, {"loss": "hl-gauss", "net_arch": (), "n_bins": 10}),
    "a2c": ("lqr", 16_000, {"loss": "hl-gauss", "n_bins": 100, "net_arch": (64, 64)}),
    "ppo": ("lqr", 8_000, {"loss": "hl-gauss-centred", "algorithm": "ppo", "batch_size": 20, "n_epochs": 2}),
    "gymnasium": ("Pendulum-v1", 4_000, {"loss": "hl-gauss", **NORMALIZED}),
    "mujoco": ("HalfCheetah-v5", 4_000, {"loss": "gaussian", **NORMALIZED}),
}
"""Environment, steps and settings of a population: 25 to 200 updates, on both engines."""
SIZES = {"n_bins": 41, "net_arch": (32, 32), "n_steps": 20, "n_envs": 4}
SEEDS = (0, 1, 2, 3)

Numbers = dict[str, np.ndarray]
"""All that a process kept, each array with an axis of runs first, by case and name."""


def main(spec: str, file: str) -> None:
    """Train what is told and keep it."""
    told = json.loads(spec)
    if told["cores"]:
        os.sched_setaffinity(0, sorted(os.sched_getaffinity(0))[: told["cores"]])
    galton.use_all_cores()
    numbers = {}
    for case in told["cases"]:
        env, steps, settings = CASES[case]
        agent, devices = read(SIZES | settings), jax.devices()[: told["devices"]]
        result = galton.train(env, agent, told["seeds"], steps, n_logs=2, n_eval_episodes=1, devices=devices)
        for path, leaf in jax.tree_util.tree_leaves_with_path(result.learner):
            name = jax.tree_util.keystr(path, simple=True, separator="/")
            numbers[f"{case}/{name}"] = np.asarray(leaf)
        for name, column in result.log.columns().items():
            numbers[f"{case}/log/{name}"] = np.asarray(column)
    np.savez(file, **numbers)


def trained(
    folder: Path,
    cases: Sequence[str] = ("a2c", "gymnasium"),
    *,
    seeds: Sequence[int] = SEEDS,
    cores: int | None = None,
    devices: int = 1,
    environment: Mapping[str, str] | None = None,
) -> Numbers:
    """What comes of a new process that compiles as users do, or as the environment says.

    Args:
        folder: for the process's compiled programs, and its numbers.
        cases: of CASES.
        seeds: a run for each.
        cores: how many it may use; None is all.
        devices: how many of JAX's devices share the runs.
        environment: variables of its environment besides the usual ones.
    """
    file = folder / "numbers.npz"
    spec = json.dumps({"cases": cases, "seeds": [*seeds], "cores": cores, "devices": devices})
    usual = {"XLA_FLAGS": "", "JAX_DISABLE_MOST_OPTIMIZATIONS": "0"}
    usual |= {"JAX_COMPILATION_CACHE_DIR": str(folder / "programs"), "JAX_PERSISTENT_CACHE_MIN_COMPILE_TIME_SECS": "0"}
    command = [sys.executable, "-W", "error", __file__, spec, str(file)]
    subprocess.run(command, check=True, timeout=600, env=os.environ | usual | (environment or {}))
    with np.load(file) as numbers:
        return dict(numbers)


def runs(numbers: Numbers, rows: Sequence[int]) -> Numbers:
    """Some runs of a population, in this order."""
    return {name: values[list(rows)] for name, values in numbers.items()}


def bytes_apart(ours: Numbers, theirs: Numbers) -> int:
    """How many bytes differ."""
    assert ours.keys() == theirs.keys()
    assert all(theirs[name].shape == values.shape for name, values in ours.items())
    pairs = [(values.tobytes(), theirs[name].tobytes()) for name, values in ours.items()]
    return sum(int((np.frombuffer(a, np.uint8) != np.frombuffer(b, np.uint8)).sum()) for a, b in pairs)


def distance(ours: Numbers, theirs: Numbers) -> float:
    """The largest difference of a parameter, relative to the largest entry of its array."""
    assert ours.keys() == theirs.keys()
    names = [name for name in ours if "/params/" in name]
    assert names
    return max(float(np.abs(ours[name] - theirs[name]).max() / np.abs(theirs[name]).max()) for name in names)


if __name__ == "__main__":
    main(*sys.argv[1:])
