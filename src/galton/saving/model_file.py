"""The settings of a saved model: what they must be before anything of their size is made."""

import math
from pathlib import Path

import numpy as np

from galton.algorithms import find_algorithm
from galton.envs.host.answers import shown
from galton.errors import CheckpointError, NewerVersionError, UsageError
from galton.records import FIRST_FIELDS, defaults, refuse_unknown
from galton.saving.checkpoint import Settings
from galton.types import Config, Hypers, make_config

MAX_BINS = 10**6
"""The most bins that settings may call for beyond the numbers in the file."""

EXAMPLE: Settings = {
    "class": "A2C",
    "env": "",
    "config": defaults(Config) | {"net_arch": []},
    "hypers": Hypers()._asdict(),
    "seed": 0,
    "step": 0,
    "log_interval": 1,
    "n_predictions": 0,
    "action_space": {},
    "observation_space": {},
}
"""What a model's file holds; of config and hypers a file leaves out later fields that have their defaults."""

MALFORMED = (
    KeyError,
    TypeError,
    ValueError,
    AttributeError,
    IndexError,
    OverflowError,
    MemoryError,
    RecursionError,
)
"""The errors that come of settings and arrays which `save` did not write."""


def unusable(path: Path, error: Exception) -> CheckpointError:
    """The error for a file whose settings or arrays make no model."""
    told = error if isinstance(error, CheckpointError | UsageError) else f"{type(error).__name__}: {error}"
    return CheckpointError(f"{path} is not a model of Galton's: {told}")


def checked(path: Path, settings: Settings, arrays: dict[str, np.ndarray]) -> Settings:
    """What `check` gives; its errors name the file.

    Raises:
        NewerVersionError: a newer version of Galton wrote it.
        CheckpointError: it is not what `save` wrote.
    """
    try:
        return check(settings, arrays)
    except NewerVersionError as error:
        raise NewerVersionError(f"{path} can't be loaded: {error}") from None
    except MALFORMED as error:
        raise unusable(path, error) from None


def check(settings: Settings, arrays: dict[str, np.ndarray]) -> Settings:
    """The settings with what they leave out filled in, once they are what `save` writes beside these arrays.

    Nothing is made of their size before that.

    Raises:
        NewerVersionError: a field that this version does not know.
        CheckpointError: anything else.
    """
    refuse_unknown("the checkpoint", settings, EXAMPLE)
    for part in ("config", "hypers"):
        _check_like(part, settings[part], {})
        refuse_unknown(f"the checkpoint's {part}", settings[part], EXAMPLE[part])
        later = {name: value for name, value in EXAMPLE[part].items() if name not in FIRST_FIELDS}
        settings = settings | {part: later | settings[part]}
    _check_like("settings", settings, EXAMPLE)
    config, step = settings["config"], settings["step"]
    size = config["n_steps"] * config["n_envs"]
    n_numbers = sum(array.size for array in arrays.values())
    n_actions, n_observations = _flat_size(settings["action_space"]), _flat_size(settings["observation_space"])
    length = arrays.get("environments/length")
    for name, fits in {
        "class": settings["class"] == find_algorithm(config["algorithm"]).label,
        "action_space": n_actions <= n_numbers,
        "observation_space": n_observations <= n_numbers,
        "step": 0 <= step < 2**31 and size > 0 and step % size == 0 and arrays["run/step"].tolist() == [step],
        "log_interval": settings["log_interval"] > 0,
        "n_predictions": 0 <= settings["n_predictions"] < 2**32,
        "n_steps": size < 2**31,
        "n_envs": length is None or length.shape == (1, config["n_envs"]),
        "n_bins": n_actions * config["n_bins"] <= max(n_numbers, MAX_BINS),
        "net_arch": len(config["net_arch"]) <= len(arrays) and sum(config["net_arch"]) <= n_numbers,
    }.items():
        if not fits:
            value = settings.get(name, config.get(name))
            raise CheckpointError(f"{name} is {shown(value)}, which does not go with the rest of it")
    return settings


def config_of(settings: Settings) -> Config:
    """The configuration in checked settings."""
    return make_config(settings["config"])


def hypers_of(settings: Settings) -> Hypers:
    """The numbers in checked settings."""
    return Hypers(**settings["hypers"])


def _check_like(name: str, given: object, like: object) -> None:
    """Raise unless given has the types and keys of like."""
    if type(given) is not type(like):
        raise CheckpointError(f"{name} is {shown(given)}; it must be of type {type(like).__name__}")
    if isinstance(given, dict) and isinstance(like, dict) and like:
        if given.keys() != like.keys():
            raise CheckpointError(f"{name} has {shown(sorted(given))}; it must have {sorted(like)}")
        for key, value in like.items():
            _check_like(key, given[key], value)


def _flat_size(record: Settings) -> int:
    """Numbers in a space, from `to_json` of it."""
    ((kind, content),) = record.items()
    if kind in ("Dict", "Tuple"):
        return sum(_flat_size(part[1] if kind == "Dict" else part) for part in content)
    if kind == "Box" and np.dtype(content[3]).kind not in "fiub":
        raise CheckpointError(f"a space is of {shown(content[3])}, not of numbers")
    sizes = {"Box": lambda: content[2], "Discrete": lambda: content[:1], "MultiBinary": lambda: content}
    size = math.prod(sizes[kind]()) if kind in sizes else int(np.sum(content))
    if size < 0:
        raise CheckpointError(f"a space is {shown(record)}, of negative size")
    return size
