"""What one version of Galton writes: `python tests/writer.py FOLDER [EARLIER] [field=value ...]`.

A plan with a finished shard and a model of each algorithm, all of them with those settings, and
names.json, which says how everything is called. What an EARLIER version wrote is read first, and gone on with.
"""

import json
import shutil
import sys
from pathlib import Path

import galton
from galton_experiments.sweep.plan import Plan
from galton_experiments.sweep.results import collect
from galton_experiments.sweep.shard import finished, work
from galton_experiments.sweep.store import Store
from galton_experiments.sweep.study import Setting, Study

SMALL = {"n_bins": 6, "net_arch": [4], "n_steps": 8, "n_envs": 1}
MODELS = {
    "a2c": (galton.A2C, "hl-gauss", {}),
    "ppo": (galton.PPO, "gaussian", {"batch_size": 4, "n_epochs": 2, "log_std_init": -0.5}),
}
LEARN = {"progress_bar": False, "log_interval": 2}


def study(**fields):
    """Settings of two algorithms, with and without what was added after version 1."""
    rows = [
        {"loss": "hl-gauss", "learning_rate": 0.01, "eta": 0.5},
        {"loss": "gaussian", "learning_rate": 0.003},
        {"loss": "gaussian", "log_std_init": -1.0, "box_units": 1.0},
        {"loss": "hl-one-hot", "policy": "ordinal"},
        {"loss": "gaussian", "algorithm": "ppo", "batch_size": 4, "n_epochs": 2, "clip_range": 0.1},
    ]
    settings = tuple(Setting({**SMALL, **row, **fields}) for row in rows)
    return Study("bandit", settings, 2, 32, logs=2, eval_episodes=1)


def write_sweep(folder, fields):
    store, plan = Store(str(folder / "sweep")), Plan.create(study(**fields), 2)
    plan.save(store)
    work(store.url, 0)
    return {
        "settings": [setting.name for setting in plan.study.settings],
        "seeds": plan.seed.tolist(),
        "shards": plan.names,
        "plan": store.read("plan.parquet").hex(),
        "done": [done.name for done in finished(store, plan).values()],
    }


def write_models(folder, fields):
    for name, (kind, loss, own) in MODELS.items():
        model = kind("bandit", loss, **{**SMALL, **own, **fields}, seed=3).learn(24, **LEARN)
        model.save(folder / name)


def go_on_with_a_sweep(earlier, folder):
    """An earlier sweep: its finished shard counts, another one is trained, and a table holds both."""
    shutil.copytree(earlier / "sweep", folder / "earlier")
    store = Store(str(folder / "earlier"))
    plan = Plan.load(store)
    before = list(finished(store, plan))
    assert plan.names == Plan.create(study(), 2).names
    work(store.url, 4)
    results = collect(store, plan)
    return {
        "counted": before,
        "columns": {name: results.column(name).to_pylist() for name in results.column_names},
    }


def go_on_with_models(earlier, folder):
    """Logs of earlier models that learn on."""
    logs = {}
    for name, (kind, *_) in MODELS.items():
        logs[name] = []
        model = kind.load(earlier / f"{name}.safetensors", "bandit")
        model.learn(24, lambda _, log, name=name: logs[name].append(log), **LEARN)
        model.save(folder / f"{name}-again")
    return logs


def main(folder, *arguments):
    folder = Path(folder)
    fields = {name: json.loads(value) for name, _, value in (a.partition("=") for a in arguments if "=" in a)}
    told = {}
    for earlier in (Path(a) for a in arguments if "=" not in a):
        told |= {"sweep": go_on_with_a_sweep(earlier, folder), "logs": go_on_with_models(earlier, folder)}
    told |= write_sweep(folder, fields)
    write_models(folder, fields)
    (folder / "names.json").write_text(json.dumps(told))


if __name__ == "__main__":
    main(*sys.argv[1:])
