"""The settings of a saved model: what they must be before anything of their size is made."""

import math
from pathlib import Path
from typing import NamedTuple

import numpy as np

from galton.agents import in_two, read, words_of
from galton.algorithms import Agent
from galton.envs.host.actions import Actions
from galton.envs.host.answers import shown
from galton.envs.host.observations import Observations
from galton.envs.host.space_json import actions_from_json, from_json, n_entries
from galton.errors import MALFORMED, CheckpointError, NewerVersionError, UsageError, in_a_line, require
from galton.networks import MLP, SimBa
from galton.parts import settings as settings_of
from galton.policies.per_entry import most_bins
from galton.records import FIRST_FIELDS, Fields, refuse_unknown
from galton.saving import checkpoint, files
from galton.saving.checkpoint import Settings
from galton.words import CHOICES, vocabulary

MAX_BINS = 10**6
"""The most bins, or entries of a space, that settings may call for beyond the numbers in the file."""

EXAMPLE: Settings = {
    "class": "A2C",
    "env": "",
    "config": {},
    "hypers": {},
    "seed": 0,
    "step": 0,
    "log_interval": 1,
    "n_predictions": 0,
    "action_space": {},
    "observation_space": {},
}
"""The settings in a model's file; config and hypers are its agent's words, but for later ones at their usual values."""

_SIZES = settings_of(MLP) | settings_of(SimBa)
"""The settings of Galton's own networks, which count units."""
SCORE = "evaluation/mean_reward"
"""The array of a best model's file that holds its mean return."""


class Saved(NamedTuple):
    """The content of a model's file, and what its settings describe."""

    path: Path
    settings: Settings
    arrays: dict[str, np.ndarray]
    agent: Agent
    """On the box of its actions."""
    actions: Actions
    observations: Observations


def with_suffix(path: Path) -> Path:
    """A path with `.safetensors` where it has no suffix, as `save` writes it; UsageError for one without a name."""
    files.check_name("path", path)
    return path if path.suffix else path.with_suffix(".safetensors")


def existing(path: Path) -> Path:
    """The file that was meant: one of that very name, or else one that `save` or SB3's callback wrote for it."""
    meant = [path, with_suffix(path), path.with_name(f"{path.name}.zip")]
    return next((file for file in meant if file.is_file()), path)


def best_before(path: Path, run: tuple[str, int, Fields], step: int) -> float:
    """The mean return of the best model that this run kept here up to this step; −inf for none.

    A run is the name of its environment, its seed and its agent's words. A file of anything else is nobody's best:
    whoever keeps a better model writes over it.
    """
    path = existing(path)
    if not path.is_file():
        return -math.inf
    try:
        saved = opened(path)
    except (CheckpointError, UsageError):
        return -math.inf
    same = run == (saved.settings["env"], saved.settings["seed"], words_of(saved.agent))
    earlier = saved.settings["step"] <= step
    return float(saved.arrays[SCORE]) if same and earlier and SCORE in saved.arrays else -math.inf


def unusable(path: Path, error: Exception) -> CheckpointError:
    """The error for a file whose settings or arrays make no model."""
    return CheckpointError(f"{path} is not a model of Galton's: {in_a_line(error)}")


def opened(path: Path) -> Saved:
    """The content of a file, once its settings are what `save` writes beside its arrays; errors name the file.

    NewerVersionError where a newer version of Galton wrote it, CheckpointError where it is not what `save` wrote.
    """
    settings, arrays = checkpoint.read(path)
    try:
        return _described(path, settings, arrays)
    except NewerVersionError as error:
        raise NewerVersionError(f"{path} can't be loaded: {error}") from None
    except MALFORMED as error:
        raise unusable(path, error) from None


def _described(path: Path, settings: Settings, arrays: dict[str, np.ndarray]) -> Saved:
    """A size that reading makes something of is one that the arrays have: spaces, layers, bins."""
    refuse_unknown("the checkpoint", settings, EXAMPLE)
    known = in_two(vocabulary().usual)
    for name, like in EXAMPLE.items():
        right = type(settings[name]) is type(like)
        require(right, f"{name} is {shown(settings[name])}; it must be of type {type(like).__name__}")
    for part, words in known.items():
        refuse_unknown(f"the checkpoint's {part}", settings[part], words)
        missing = [name for name in words if name in FIRST_FIELDS and name not in settings[part]]
        require(not missing, f"{part} lacks {', '.join(missing)}")
    choices = {choice.word: choice for choice in CHOICES.values()}
    for name, value in settings["config"].items():
        long = name in _SIZES and isinstance(value, list) and len(value) > len(arrays)
        require(not long, f"{name} is {shown(value)}, longer than the list of arrays in the file")
        if name in choices and isinstance(value, str) and value != choices[name].usual:
            refuse_unknown(f"the checkpoint's {name}", [value], choices[name].registry)
    agent = read({**settings["config"], **settings["hypers"]})
    n_numbers = sum(array.size for array in arrays.values())
    records = settings["action_space"], settings["observation_space"]
    for record in records:
        require(
            n_entries(record) <= max(n_numbers, MAX_BINS),
            f"a space is {shown(record)}, larger than all that is in the file",
        )
    actions = actions_from_json("the checkpoint", records[0])
    observations = Observations("the checkpoint", from_json(records[1]), actions.n_mask)
    step, size, network = settings["step"], agent.rollout.size, agent.network
    fitting = {
        "class": settings["class"] == agent.algorithm.label,
        "step": 0 <= step < 2**31 * size and step % size == 0 and arrays["run/step"].tolist() == [step],
        "log_interval": settings["log_interval"] > 0,
        "n_predictions": 0 <= settings["n_predictions"] < 2**32,
        "n_steps": size < 2**31,
        "n_bins": len(actions.box.low) * most_bins(agent.policy) <= max(n_numbers, MAX_BINS),
        **{name: _n_units(getattr(network, name)) <= n_numbers for name in _SIZES if hasattr(network, name)},
    }
    for name, fits in fitting.items():
        value = settings.get(name, settings["config"].get(name))
        require(fits, f"{name} is {shown(value)}, which does not go with the rest of it")
    return Saved(path, settings, arrays, agent.on(actions.box), actions, observations)


def _n_units(value: object) -> int:
    """The number of units or blocks that a setting of a network says that it has."""
    return sum(size for size in (value if isinstance(value, tuple) else [value]) if isinstance(size, int))
