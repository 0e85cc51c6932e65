"""How the golden files of version 2 were made: `python tests/golden/make_v2.py FOLDER`, with the code of that time.

What 0.1.0's first files (v1) do not have: PPO, the settings that came after them, and what is exported. They are never
made again, and nothing but that code need be able to run this file.
"""

import dataclasses
import json
import shutil
import subprocess
import sys
from pathlib import Path

import jax
import numpy as np

import galton
from galton.sweep.plan import Plan
from galton.sweep.store import Store

SMALL = {"net_arch": [8], "n_bins": 11, "learning_rate": 0.01, "seed": 3}
PPO = {"n_steps": 8, "n_envs": 2, "batch_size": 8, "n_epochs": 2}
CHECKPOINTS = {
    "ppo-gaussian": (
        galton.PPO,
        "bandit",
        {"loss": "gaussian", **PPO, "log_std_init": -0.5, "target_kl": 0.5, "decay_steps": 4000, "box_units": 1.0},
    ),
    "ppo-ordinal": (
        galton.PPO,
        "lqr",
        {"loss": "hl-gauss", "policy": "ordinal", **PPO, "normalize_observation": True, "normalize_reward": True},
    ),
    "ppo-smoothed": (galton.PPO, "lqr", {"loss": "hl-gauss", "ratio": "smoothed", **PPO, "clip_range": 0.1}),
    "a2c-later": (
        galton.A2C,
        "bandit",
        {"loss": "gaussian", "n_steps": 5, "log_std_min": -2.0, "clip_separately": True, "box_units": 1.0},
    ),
}
"""Classes, environments and settings of the models."""
BEFORE, AFTER, INTERVAL = 7, 8, 5
"""Updates before and after the save, which lies between two log points, and updates from one log point to the next."""
GRID = """\
[[grid]]
loss = "gaussian"
box_units = [0.0, 1.0]

[[grid]]
loss = "hl-one-hot"
n_bins = 20
policy = ["histogram", "ordinal"]
"""
SWEEP = (
    "sweep bandit --algorithm ppo --grid grid.toml --trials 2 --steps 200 --logs 4 --eval-episodes 2 --shard-width 4 "
    "--seed 5 --common-seeds --eval-mean --n-steps 20 --batch-size 10 --n-epochs 2"
)
MISSING = 1
"""The shard that is taken away."""
TRAIN = (
    "train bandit --algorithm ppo --loss hl-gauss --n-bins 20 --n-steps 20 --batch-size 10 --n-epochs 2 --steps 200 "
    "--logs 4 --eval-episodes 2 --seed 1 --normalize-observation --out run"
)
N_OBSERVATIONS = 20


def main(folder: Path) -> None:
    folder.mkdir(parents=True)
    galton.use_all_cores()
    for make in (checkpoints, sweep, run):
        print(make.__name__, flush=True)
        make(folder)


def command(line: str, folder: Path) -> None:
    subprocess.run([sys.executable, "-m", "galton", *line.split()], cwd=folder, check=True)


def write(path: Path, record: object) -> None:
    path.write_text(json.dumps(record, indent=1) + "\n")


def by_path(tree: object) -> dict[str, np.ndarray]:
    leaves = jax.tree_util.tree_leaves_with_path(tree)
    return {jax.tree_util.keystr(path, simple=True, separator="/"): np.asarray(leaf) for path, leaf in leaves}


def checkpoints(folder: Path) -> None:
    """Models in the middle of training, and what becomes of them; the form of v1's, with the name of the class."""
    records, arrays = {}, {}
    (folder / "checkpoints").mkdir()
    learn = {"progress_bar": False, "log_interval": INTERVAL}
    for name, (kind, env, settings) in CHECKPOINTS.items():
        path = folder / "checkpoints" / f"{name}.safetensors"
        model = kind(env, **SMALL | settings)
        size = model.config.n_steps * model.config.n_envs
        model.learn(BEFORE * size, **learn)
        observation = np.linspace(-0.5, 0.5, model.observation_space.shape[0], dtype=np.float32)
        model.predict(observation)  # so that the count of predictions is not 0
        model.save(path)
        records[name] = {
            "class": kind.__name__,
            "env": env,
            "config": dataclasses.asdict(model.config),
            "hypers": {key: None if np.isinf(value) else value for key, value in model.hypers._asdict().items()},
            "seed": model.seed,
            "step": model.num_timesteps,
            "observation": observation.tolist(),
            "deterministic": model.predict(observation, deterministic=True)[0].tolist(),
            "explored": model.predict(observation)[0].tolist(),
            "more": AFTER * size,
            "log_interval": INTERVAL,
        }
        arrays |= {f"{name}/before/{key}": value for key, value in by_path(model.learner.params).items()}
        logs = []
        loaded = kind.load(path, env)
        loaded.learn(AFTER * size, lambda _, log, logs=logs: logs.append(log), **learn)
        arrays |= {f"{name}/after/{key}": value for key, value in by_path(loaded.learner.params).items()}
        known = [key for key in logs[0] if key not in ("time/time_elapsed", "time/fps")]
        arrays |= {f"{name}/log/{key}": np.array([log[key] for log in logs]) for key in known}
    write(folder / "checkpoints.json", records)
    np.savez_compressed(folder / "checkpoints.npz", **arrays)


def sweep(folder: Path) -> None:
    """A sweep of PPO over later settings whose results were collected, and then one shard was lost."""
    (folder / "grid.toml").write_text(GRID)
    command(f"{SWEEP} --workers 1 --out sweep", folder)
    plan = Plan.load(Store(str(folder / "sweep")))
    (folder / "sweep" / ".lock").unlink(missing_ok=True)
    (lost,) = (folder / "sweep" / "shards").glob(f"{MISSING:07d}-*")
    record = {
        "command": SWEEP.split(),
        "settings": [setting.name for setting in plan.study.settings],
        "setting": plan.setting.tolist(),
        "trial": plan.trial.tolist(),
        "seed": plan.seed.tolist(),
        "shards": plan.names,
        "missing": MISSING,
    }
    lost.unlink()
    write(folder / "sweep.json", record)


def run(folder: Path) -> None:
    """A run folder of PPO with what was exported of it, what the policy does, and what it holds after going on."""
    command(TRAIN, folder)
    command("export run --format onnx card", folder)
    model = galton.PPO.load(folder / "run" / "model.safetensors")
    observations = np.linspace(-2, 2, N_OBSERVATIONS, dtype=np.float32)[:, None]
    actions = model.predict(observations, deterministic=True)[0]
    shutil.copytree(folder / "run", folder / "resumed" / "run")
    longer = TRAIN.replace("--steps 200", "--steps 400")
    command(f"{longer} --resume", folder / "resumed")
    after = galton.PPO.load(folder / "resumed" / "run" / "model.safetensors")
    lines = (folder / "resumed" / "run" / "metrics.jsonl").read_text().splitlines()
    record = {"command": f"{longer} --resume".split(), "metrics": [json.loads(line) for line in lines]}
    write(folder / "run.json", record)
    exported = {"exported/observations": observations, "exported/actions": actions}
    np.savez_compressed(folder / "run.npz", **exported, **by_path(after.learner.params))
    shutil.rmtree(folder / "resumed")


if __name__ == "__main__":
    main(Path(sys.argv[1]))
