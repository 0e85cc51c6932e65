"""How the golden files of version 3 were made: `python tests/golden/make_v3.py FOLDER`, with the code of that time.

What the first two do not have: the presets, and the settings, heads, critics and weights that came after them; a task
outside JAX with observations in float64; the name of every setting; and a benchmark. They are never made again, and
nothing but that code need be able to run this file.
"""

import dataclasses
import shutil
import sys
from pathlib import Path

import numpy as np
from make_v2 import by_path, command, write

import galton
from galton.benchmark import stages
from galton.benchmark.draws import draws
from galton.benchmark.reading import read
from galton.sweep.study import DEFAULTS, Setting

ROOT = Path(__file__).parents[2]

SMALL = {"net_arch": [8], "n_bins": 11, "learning_rate": 0.01, "seed": 3}
ROLLOUT = {"n_steps": 8, "n_envs": 2}
PPO = {**ROLLOUT, "batch_size": 8, "n_epochs": 2}
NORMALISED = {"normalize_observation": True, "normalize_reward": True}
HELD = {"entropy_target": True, "entropy_steps": 400.0, "entropy_end": 0.1}
FOLLOWING = {"eta_rule": "policy", "eta": 2.0, "bin_centers": "bounds", "target_tails": "edges"}
STARTED = {"initial_policy": "clipped-gaussian", "box_units": 1.0, "log_std_init": -0.5}
CHECKPOINTS = {
    "ppo-preset-gaussian": (galton.PPO, "lqr", {"preset": "gaussian", **PPO}),
    "ppo-preset-classification": (galton.PPO, "lqr", {"preset": "classification", **PPO}),
    "a2c-preset-gaussian": (galton.A2C, "bandit", {"preset": "gaussian", **ROLLOUT}),
    "a2c-preset-classification": (galton.A2C, "lqr", {"preset": "classification", **ROLLOUT}),
    "ppo-held-hl-gauss-critic": (
        galton.PPO,
        "lqr",
        {"loss": "hl-one-hot", **PPO, **NORMALISED, **HELD, "critic": "hl-gauss", "n_value_bins": 21},
    ),
    "ppo-floor-two-hot-critic": (
        galton.PPO,
        "lqr",
        {"loss": "gaussian", **PPO, **HELD, "entropy_alpha_min": 0.0, "critic": "two-hot", "value_min": -50.0},
    ),
    "a2c-held": (
        galton.A2C,
        "bandit",
        {"loss": "hl-gauss", **ROLLOUT, **HELD, "critic": "hl-gauss", "value_min": -2.0, "ent_coef": 0.01},
    ),
    "a2c-following-awr": (
        galton.A2C,
        "bandit",
        {"loss": "hl-gauss-centred", **ROLLOUT, **FOLLOWING, **STARTED, "weighting": "awr", "temperature": 2.0},
    ),
    "ppo-v-mpo": (
        galton.PPO,
        "lqr",
        {"loss": "hl-gauss", **PPO, "weighting": "v-mpo", "eta": 0.75},
    ),
    "ppo-split-following": (galton.PPO, "lqr", {"loss": "hl-gauss", **PPO, **FOLLOWING, "negative_target": "one-hot"}),
    "ppo-true-ratio": (galton.PPO, "bandit", {"loss": "hl-gauss", **PPO, "ratio": "true", "clip_separately": True}),
    "ppo-rpo": (galton.PPO, "lqr", {"loss": "gaussian", "policy": "rpo", **PPO, "rpo_alpha": 0.3}),
    "ppo-beta": (galton.PPO, "lqr", {"loss": "gaussian", "policy": "beta", **PPO}),
    "ppo-squashed": (galton.PPO, "lqr", {"loss": "gaussian", "policy": "squashed-gaussian", **PPO}),
    "ppo-truncated": (galton.PPO, "bandit", {"loss": "gaussian", "policy": "truncated-gaussian", **PPO}),
    "a2c-clipped-correlated": (
        galton.A2C,
        "mountain-car",
        {"loss": "gaussian", "policy": "clipped-gaussian", **ROLLOUT, "noise_correlation": 0.8, "box_units": 1.0},
    ),
    "ppo-smoothed-correlated": (
        galton.PPO,
        "lqr",
        {"loss": "hl-gauss", "policy": "smoothed", **PPO, "noise_correlation": 0.5, "eta": 1.5},
    ),
    "ppo-reacher": (galton.PPO, "Reacher-v5", {"loss": "hl-gauss-centred", "eta": 2.0, **PPO, **NORMALISED}),
}
"""Classes, environments and settings of the models."""
BEFORE, AFTER, INTERVAL = 7, 8, 5
"""Updates before and after the save, which lies between two log points, and updates from one log point to the next."""
OTHER = {
    "loss": "gaussian",
    "policy": "ordinal",
    "algorithm": "ppo",
    "critic": "two-hot",
    "net_arch": [32, 16],
    "decay_steps": 1000.0,
    "log_std_min": -3.0,
    "target_kl": 0.02,
    "entropy_alpha_min": 0.0,
    "noise_correlation": 0.5,
    "box_units": 1.0,
}
"""What fields are set to for their settings' names; a word to the next in its annotation, a number to half of it."""
BESIDE = [
    {"loss": "hl-gauss"},
    {"loss": "gaussian"},
    {"loss": "hl-gauss", "algorithm": "ppo"},
    {"loss": "hl-gauss", "normalize_reward": True},
    {"loss": "hl-gauss", "critic": "hl-gauss", "normalize_reward": True},
    {"loss": "hl-gauss", "eta_rule": "policy"},
    {"loss": "hl-gauss", "weighting": "awr"},
    {"loss": "hl-gauss", "entropy_target": True},
    {"loss": "gaussian", "policy": "rpo"},
]
"""What a field may need beside it; the first that goes is taken."""
BENCHMARK = """\
title = "Small"
seed = 5
baseline = "gaussian"

[budget]
settings = 2
seeds = 1
fresh_seeds = 2
steps = 160
logs = 2
eval_episodes = 2

[fixed]
algorithm = "ppo"
n_envs = 2
n_steps = 8
batch_size = 8
n_epochs = 2
net_arch = [8]

[prior]
learning_rate = { log-uniform = [1e-3, 1e-2] }

[methods.gaussian]
label = "Gaussian"
fixed = { loss = "gaussian", box_units = 1 }
search = { log_std_init = { uniform = [-1, 0] } }

[methods.centred]
label = "Centred HL-Gauss"
fixed = { loss = "hl-gauss-centred", n_bins = 11 }
search = { eta = { uniform = [1, 4] } }

[tasks.lqr]
label = "LQR"
env = "lqr"

[tasks.bandit]
label = "Bandit"
env = "bandit"
held_out = true
"""


def main(folder: Path) -> None:
    folder.mkdir(parents=True)
    galton.use_all_cores()
    for make in (checkpoints, names, benchmark):
        print(make.__name__, flush=True)
        make(folder)


def checkpoints(folder: Path) -> None:
    """Models in the middle of training, and what becomes of them; the form of v2's."""
    records, arrays = {}, {}
    (folder / "checkpoints").mkdir()
    learn = {"progress_bar": False, "log_interval": INTERVAL}
    for name, (kind, env, settings) in CHECKPOINTS.items():
        print(name, flush=True)
        path = folder / "checkpoints" / f"{name}.safetensors"
        model = kind(env, **SMALL | settings)
        size = model.config.rollout_size
        model.learn(BEFORE * size, **learn)
        observation = np.linspace(-0.5, 0.5, model.observation_space.shape[0])
        model.predict(observation)  # so that the count of predictions is not 0
        model.save(path)
        records[name] = {
            "class": kind.__name__,
            "env": env,
            "config": dataclasses.asdict(model.config),
            "hypers": {
                key: value if np.isfinite(value) else str(value) for key, value in model.hypers._asdict().items()
            },
            "seed": model.seed,
            "step": model.num_timesteps,
            "observation": observation.tolist(),
            "deterministic": model.predict(observation, deterministic=True)[0].tolist(),
            "explored": model.predict(observation)[0].tolist(),
            "more": AFTER * size,
            "log_interval": INTERVAL,
        }
        arrays |= {f"{name}/before/{key}": value for key, value in by_path(model.learner).items()}
        model.close()
        logs = []
        loaded = kind.load(path, env)
        loaded.learn(AFTER * size, lambda _, log, logs=logs: logs.append(log), **learn)
        arrays |= {f"{name}/after/{key}": value for key, value in by_path(loaded.learner).items()}
        known = [key for key in logs[0] if key not in ("time/time_elapsed", "time/fps")]
        arrays |= {f"{name}/log/{key}": np.array([log[key] for log in logs]) for key in known}
        loaded.close()
    write(folder / "checkpoints.json", records)
    np.savez_compressed(folder / "checkpoints.npz", **arrays)


def names(folder: Path) -> None:
    """The name of a setting of each field, off its default; and those that the published benchmarks draw."""
    settings = {}
    for field, default in DEFAULTS.items():
        record = next(filter(goes, ({**beside, field: other(field, default)} for beside in BESIDE)))
        settings[field] = {"record": record, "name": Setting.of_record(record).name}
    files = sorted((ROOT / "benchmarks").glob("*.toml"))
    parts = {}
    for file in files:
        protocol = read(file)
        tuning = stages.tuning(protocol, draws(protocol))
        parts[file.name] = {
            "digest": protocol.digest,
            "tuning": {part.name: [[s.name for s in study.settings] for study in part.studies] for part in tuning},
        }
    write(folder / "names.json", {"settings": settings, "benchmarks": parts})


def goes(record: dict[str, object]) -> bool:
    """Whether a record is a setting's: what a loss or an algorithm has no use for is refused."""
    try:
        Setting.of_record(record)
    except galton.UsageError:
        return False
    return True


def other(field: str, default: object) -> object:
    """Another value of a field."""
    if field in OTHER:
        return OTHER[field]
    if isinstance(default, bool):
        return not default
    if isinstance(default, str):
        annotation = galton.Config.__annotations__[field]
        words = eval(annotation.removeprefix("Literal") if isinstance(annotation, str) else repr(annotation.__args__))
        return next(word for word in words if word != default)
    return default + 3 if isinstance(default, int) else (default / 2 or 0.5)


def benchmark(folder: Path) -> None:
    """A benchmark that was done: its file, its folder without page and figures."""
    (folder / "small.toml").write_text(BENCHMARK)
    command("benchmark small.toml --workers 1 --out benchmark", folder)
    for path in ((folder / "benchmark") / name for name in ("index.html", ".lock")):
        path.unlink(missing_ok=True)
    for path in sorted((folder / "benchmark" / "figures").glob("*")):
        path.unlink()
    (folder / "benchmark" / "figures").rmdir()
    shutil.rmtree(folder / "benchmark" / "sweeps")  # the data stands for them


if __name__ == "__main__":
    main(Path(sys.argv[1]))
