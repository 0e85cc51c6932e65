"""How the golden files of version 1 were made: `python tests/golden/make.py FOLDER`, with the code of that time.

They are never made again, and nothing but that code need be able to run this file. A later version adds a folder and a
script of its own beside it.
"""

import dataclasses
import hashlib
import json
import shutil
import subprocess
import sys
import warnings
from pathlib import Path

import jax
import numpy as np
from galton.studies import reproduce
from galton.studies.claims import all_claims

import galton
from galton import A2C, Config, Hypers
from galton.losses import LOSSES
from galton.sweep.grid import paper_grid, task_defaults
from galton.sweep.plan import Plan, fold_in
from galton.sweep.store import Store
from galton.sweep.study import Study

TESTS = Path(__file__).parents[1]
PAPER = TESTS.parent / "results" / "paper"

SMALL = {"net_arch": [8], "n_bins": 11, "learning_rate": 0.01, "seed": 3}
CHECKPOINTS = {
    "bandit-gaussian": ("bandit", {"loss": "gaussian", "n_steps": 5}),
    "bandit-one-hot": (
        "bandit",
        {
            "loss": "hl-one-hot",
            "n_steps": 5,
            "bin_sample": "uniform",
            "initial_policy": "gaussian",
            "deterministic_action": "mean",
            "normalize_advantage": True,
            "ent_coef": 0.01,
        },
    ),
    "lqr-hl-gauss": (
        "lqr",
        {
            "loss": "hl-gauss",
            "n_steps": 10,
            "n_envs": 4,
            "normalize_observation": True,
            "normalize_reward": True,
            "gae_lambda": 0.95,
        },
    ),
    "lqr-centred": ("lqr", {"loss": "hl-gauss-centred", "eta": 2.0, "exploration": "gaussian", "n_envs": 2}),
    "swing-hl-gauss": (
        "stateful_swing",
        {"loss": "hl-gauss", "n_steps": 4, "n_envs": 2, "normalize_observation": True, "normalize_reward": True},
    ),
    "pendulum-gaussian": ("Pendulum-v1", {"loss": "gaussian", "n_envs": 2, "normalize_observation": True}),
    "reacher-hl-gauss": ("Reacher-v5", {"loss": "hl-gauss", "n_envs": 2}),
}
"""Environments and settings of the models; `stateful_swing` is that of tests/swing.py."""
BEFORE, AFTER, INTERVAL = 7, 8, 5
"""Updates before and after the save, which lies between two log points, and updates from one log point to the next."""

GRID = """\
[[grid]]
loss = "gaussian"
learning_rate = [0.05, 0.1]

[[grid]]
loss = "hl-gauss"
n_bins = 20
eta = [0.25, 0.75]
"""
SWEEP = "sweep bandit --grid grid.toml --trials 3 --steps 200 --logs 4 --eval-episodes 2 --shard-width 4 --seed 5"
MISSING = 1
"""The shard that is taken away: the second and shorter one of the Gaussian."""
TRAIN = "train bandit --loss hl-gauss --n-bins 20 --steps 200 --logs 4 --eval-episodes 2 --seed 1 --out run"
COMPARE = "compare bandit --losses gaussian hl-gauss --n-bins 20 --seeds 2 --steps 200 --logs 2 --eval-episodes 2"


def main(folder: Path) -> None:
    folder.mkdir(parents=True)
    galton.use_all_cores()
    for make in (checkpoints, sweep, results, run, compare, names, paper, bits):
        print(make.__name__, flush=True)
        make(folder)


def command(line: str, folder: Path) -> None:
    subprocess.run([sys.executable, "-m", "galton", *line.split()], cwd=folder, check=True)


def write(path: Path, record: object) -> None:
    path.write_text(json.dumps(record, indent=1) + "\n")


def params(model: A2C) -> dict[str, np.ndarray]:
    return by_path(model.learner.params)


def by_path(tree: object) -> dict[str, np.ndarray]:
    leaves = jax.tree_util.tree_leaves_with_path(tree)
    return {jax.tree_util.keystr(path, simple=True, separator="/"): np.asarray(leaf) for path, leaf in leaves}


def checkpoints(folder: Path) -> None:
    """Models in the middle of training, and what becomes of them."""
    records, arrays = {}, {}
    (folder / "checkpoints").mkdir()
    for name, (env, settings) in CHECKPOINTS.items():
        path = folder / "checkpoints" / f"{name}.safetensors"
        model = A2C(environment(env), **SMALL | settings)
        size = model.config.n_steps * model.config.n_envs
        learn = {"progress_bar": False, "log_interval": INTERVAL}
        model.learn(BEFORE * size, **learn)
        observation = np.linspace(-0.5, 0.5, model.observation_space.shape[0], dtype=np.float32)
        model.predict(observation)  # so that the count of predictions is not 0
        model.save(path)
        records[name] = {
            "env": env,
            "config": dataclasses.asdict(model.config),
            "hypers": model.hypers._asdict(),
            "seed": model.seed,
            "step": model.num_timesteps,
            "observation": observation.tolist(),
            "deterministic": model.predict(observation, deterministic=True)[0].tolist(),
            "explored": model.predict(observation)[0].tolist(),
            "more": AFTER * size,
            "log_interval": INTERVAL,
        }
        arrays |= {f"{name}/before/{key}": value for key, value in params(model).items()}
        model.close()
        with warnings.catch_warnings(record=True) as told:
            warnings.simplefilter("always", galton.InexactResume)
            loaded = A2C.load(path, environment(env))
        records[name]["exact"] = not told
        if not told:
            logs = []
            loaded.learn(AFTER * size, lambda _, log, logs=logs: logs.append(log), **learn)
            arrays |= {f"{name}/after/{key}": value for key, value in params(loaded).items()}
            known = [key for key in logs[0] if key not in ("time/time_elapsed", "time/fps")]
            arrays |= {f"{name}/log/{key}": np.array([log[key] for log in logs]) for key in known}
        loaded.close()
    write(folder / "checkpoints.json", records)
    np.savez_compressed(folder / "checkpoints.npz", **arrays)


def environment(name: str):
    if name != "stateful_swing":
        return name
    sys.path.insert(0, str(TESTS))
    import swing

    return swing.stateful_swing


def sweep(folder: Path) -> None:
    """A sweep whose results were collected, and then one shard was lost."""
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


def results(folder: Path) -> None:
    """What `galton reproduce` keeps, and what the report makes of it."""
    command("reproduce bandit --budget smoke --workers 1 --out results", folder)
    shutil.rmtree(folder / "results" / "sweeps")
    shutil.rmtree(folder / "results" / "figures")
    (folder / "results" / "index.html").unlink()
    write(folder / "results.json", told_by(folder / "results"))


def paper(folder: Path) -> None:
    """What the report makes of the results that were published with this version."""
    write(folder / "paper.json", told_by(PAPER))


def told_by(out: Path) -> dict[str, object]:
    data = reproduce.load(str(out))
    files = sorted((out / "data").iterdir())
    claims = [[claim.source, claim.number, claim.verdict] for claim in all_claims(data)]
    return {
        "files": {path.name: hashlib.sha256(path.read_bytes()).hexdigest() for path in files},
        "sweeps": {name: summarised(summary) for name, summary in data.sweeps.items()},
        "claims": claims,
    }


def summarised(summary) -> dict[str, object]:
    names = [setting.name for setting in summary.study.settings]
    best = {
        loss: [best.setting.name, float(best.final_training_return.mean()), float(best.final_evaluation_return.mean())]
        for loss, best in summary.best.items()
    }
    return {"runs": summary.table.num_rows, "settings": len(names), "names": digest(names), "best": best}


def digest(words: list[str]) -> str:
    return hashlib.sha256("\n".join(words).encode()).hexdigest()


def run(folder: Path) -> None:
    """A run folder, and what it holds after going on to twice the steps."""
    command(TRAIN, folder)
    shutil.copytree(folder / "run", folder / "resumed" / "run")
    longer = TRAIN.replace("--steps 200", "--steps 400")
    command(f"{longer} --resume", folder / "resumed")
    after = A2C.load(folder / "resumed" / "run" / "model.safetensors")
    lines = (folder / "resumed" / "run" / "metrics.jsonl").read_text().splitlines()
    write(
        folder / "run.json", {"command": f"{longer} --resume".split(), "metrics": [json.loads(line) for line in lines]}
    )
    np.savez_compressed(folder / "run.npz", **params(after))
    shutil.rmtree(folder / "resumed")


def compare(folder: Path) -> None:
    """The folder of a comparison, without its figure."""
    command(f"{COMPARE} --out compare", folder)
    for figure in (folder / "compare").glob("learning_curves.*"):
        figure.unlink()


def names(folder: Path) -> None:
    """Names of settings, seeds of runs, and names of shards, of the paper's grids."""
    record = {}
    for env in ("bandit", "lqr", "HalfCheetah-v5"):
        settings = paper_grid(env, task_defaults(env))
        found = [setting.name for setting in settings]
        seeds = {
            str(study): [[fold_in(study, name, trial) for trial in range(3)] for name in found] for study in (0, 1)
        }
        plan = Plan.create(Study(env, settings, 3, 1000))
        record[env] = {"settings": found, "seeds": seeds, "shards": plan.names}
    (folder / "names.json").write_text(json.dumps(record) + "\n")


def bits(folder: Path) -> None:
    """Curves and parameters of populations: every loss on the scan engine, two on the host engine."""
    lqr = {
        "env": "lqr",
        "config": {"net_arch": [16, 16], "n_bins": 20, "n_steps": 20},
        "hypers": {"learning_rate": 1e-3, "eta": 0.75},
        "seeds": [0, 1],
        "total_timesteps": 2000,
        "n_logs": 2,
        "n_eval_episodes": 2,
    }
    pendulum = lqr | {"env": "Pendulum-v1", "seeds": [0], "total_timesteps": 200, "n_eval_episodes": 1}
    cases = {f"lqr/{loss}": lqr | {"loss": loss} for loss in LOSSES}
    cases |= {f"Pendulum-v1/{loss}": pendulum | {"loss": loss} for loss in ("gaussian", "hl-gauss")}
    arrays = {}
    for name, case in cases.items():
        options = {key: case[key] for key in ("seeds", "total_timesteps", "n_logs", "n_eval_episodes")}
        config = Config(case["loss"], **case["config"])
        result = galton.train(case["env"], config, Hypers(**case["hypers"]), **options)
        arrays |= {f"{name}/log/{key}": value for key, value in result.log._asdict().items()}
        arrays |= {f"{name}/params/{key}": value for key, value in by_path(result.learner.params).items()}
    write(folder / "bits.json", cases)
    np.savez_compressed(folder / "bits.npz", **arrays)


if __name__ == "__main__":
    main(Path(sys.argv[1]))
