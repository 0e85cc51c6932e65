"""A trained run on disk: settings as JSON, arrays as safetensors. Loading runs no code."""

import dataclasses
import json
from pathlib import Path
from typing import Any, NamedTuple

import jax
import numpy as np
from safetensors.numpy import load_file, save_file

from galton.algorithms import a2c
from galton.envs.base import Environment
from galton.envs.registry import make
from galton.errors import require
from galton.types import Config, Hypers, Learner


class Checkpoint(NamedTuple):
    """One run: what it was trained with and what it became."""

    env_name: str
    env_constants: dict[str, Any]
    config: Config
    hypers: Hypers
    """Plain numbers."""
    seed: int
    step: int
    learner: Learner

    def make_env(self) -> Environment:
        """The environment that it was trained on."""
        return make(self.env_name, **self.env_constants)


def save(folder: Path, checkpoint: Checkpoint) -> None:
    """Write checkpoint.json and checkpoint.safetensors into an existing folder."""
    settings = checkpoint._asdict() | {
        "config": dataclasses.asdict(checkpoint.config),
        "hypers": {name: float(value) for name, value in checkpoint.hypers._asdict().items()},
    }
    del settings["learner"]
    (folder / "checkpoint.json").write_text(json.dumps(settings, indent=2) + "\n")
    save_file(_flatten(checkpoint.learner), folder / "checkpoint.safetensors")


def load(folder: Path) -> Checkpoint:
    """Read what `save` wrote.

    Raises:
        UsageError: arrays that don't fit the settings.
    """
    settings = json.loads((folder / "checkpoint.json").read_text())
    config = settings["config"] | {"net_arch": tuple(settings["config"]["net_arch"])}
    checkpoint = Checkpoint(
        **settings | {"config": Config(**config), "hypers": Hypers(**settings["hypers"])},
        learner=Learner({}, ()),
    )
    return checkpoint._replace(learner=_unflatten(load_file(folder / "checkpoint.safetensors"), checkpoint))


def _flatten(learner: Learner) -> dict[str, np.ndarray]:
    leaves = jax.tree_util.tree_leaves_with_path(learner)
    return {jax.tree_util.keystr(path, simple=True, separator="/"): np.array(leaf) for path, leaf in leaves}


def _unflatten(arrays: dict[str, np.ndarray], checkpoint: Checkpoint) -> Learner:
    """Into the structure that the settings call for."""
    env = checkpoint.make_env()
    policy = a2c.make_policy(checkpoint.config, env.action_low, env.action_high)
    init = jax.eval_shape(
        lambda key: a2c.init(key, checkpoint.config, policy, len(env.observation_low)), jax.random.key(0)
    )
    leaves, structure = jax.tree_util.tree_flatten_with_path(init)
    names = [jax.tree_util.keystr(path, simple=True, separator="/") for path, _ in leaves]
    for name, (_, leaf) in zip(names, leaves, strict=True):
        found = arrays[name].shape if name in arrays else None
        require(
            found == leaf.shape,
            f"{name} in the checkpoint has shape {found}; its settings call for {leaf.shape}",
        )
    learner: Learner = jax.tree.unflatten(structure, [arrays[name] for name in names])
    return learner
