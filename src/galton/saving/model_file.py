"""The settings of a saved model: what they must be before anything of their size is made."""

import math
from collections.abc import Callable
from pathlib import Path

import numpy as np

from galton.agents import in_two, read
from galton.agents import words_of as words_of_agent
from galton.algorithms import Agent, find_algorithm
from galton.envs.host.answers import shown
from galton.errors import MALFORMED, CheckpointError, NewerVersionError, UsageError, in_a_line
from galton.networks import NETWORKS
from galton.parts import settings as settings_of
from galton.records import FIRST_FIELDS, Fields, refuse_unknown
from galton.saving import checkpoint, files
from galton.saving.checkpoint import Settings
from galton.words import vocabulary

MAX_BINS = 10**6
"""The most bins that settings may call for beyond the numbers in the file."""

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
"""What a model's file holds; config and hypers are the words of its agent, but for later ones at their usual values."""

SCORE = "evaluation/mean_reward"
"""The array of a best model's file that holds its mean return."""


def with_suffix(path: Path) -> Path:
    """The file that `save` writes for a path: `.safetensors` is added to a name without a suffix.

    Raises:
        UsageError: the path has no name.
    """
    files.check_name("path", path)
    return path if path.suffix else path.with_suffix(".safetensors")


def existing(path: Path) -> Path:
    """The file that was meant: the one of that very name, or else the one that `save` would have written for it."""
    saved_as = with_suffix(path)
    return saved_as if not path.is_file() and saved_as.is_file() else path


def best_before(path: Path, env_name: str, agent: Agent, step: int) -> float:
    """The mean return of the best model that a run of this agent kept at this path up to this step; −inf for none.

    A file of anything else is nobody's best: whoever keeps a better model writes over it.
    """
    path = existing(path)
    if not path.is_file():
        return -math.inf
    try:
        settings, arrays = checkpoint.read(path)
        settings = checked(path, settings, arrays)
        other = words_of_agent(read(words_of(settings)))
    except (CheckpointError, UsageError, *MALFORMED):
        return -math.inf
    same = settings["env"] == env_name and other == words_of_agent(agent)
    return float(arrays[SCORE]) if same and settings["step"] <= step and SCORE in arrays else -math.inf


def unusable(path: Path, error: Exception) -> CheckpointError:
    """The error for a file whose settings or arrays make no model."""
    return CheckpointError(f"{path} is not a model of Galton's: {in_a_line(error)}")


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

    A size in them that reading makes something of is one that the arrays have: spaces, layers, copies of an environment
    that tells its state. What training would take is refused where it begins (`check_size`).

    Raises:
        NewerVersionError: a field that this version does not know.
        CheckpointError: anything else.
    """
    refuse_unknown("the checkpoint", settings, EXAMPLE)
    example = EXAMPLE | in_two(vocabulary().usual)
    for part in ("config", "hypers"):
        _check_like(part, settings[part], {})
        refuse_unknown(f"the checkpoint's {part}", settings[part], example[part])
        later = {name: value for name, value in example[part].items() if name not in FIRST_FIELDS}
        settings = settings | {part: later | settings[part]}
    numbers = {name: 0.0 if isinstance(value, str) else value for name, value in settings["hypers"].items()}
    _check_like("settings", settings | {"hypers": numbers}, example)  # a text is a schedule, which `read` checks
    config = settings["config"]
    for name, fits in _fitting(settings, arrays).items():
        if not fits:
            value = settings.get(name, config.get(name, config["n_steps"] * config["n_envs"]))
            raise CheckpointError(f"{name} is {shown(value)}, which does not go with the rest of it")
    return settings


def _fitting(settings: Settings, arrays: dict[str, np.ndarray]) -> dict[str, bool]:
    """Whether each setting goes with the others and with the arrays."""
    config, step = settings["config"], settings["step"]
    size = config["n_steps"] * config["n_envs"]
    n_numbers = sum(array.size for array in arrays.values())
    n_actions, n_observations = _flat_size(settings["action_space"]), _flat_size(settings["observation_space"])
    length = arrays.get("environments/length")
    return {
        "class": settings["class"] == find_algorithm(config["algorithm"]).label,
        "action_space": n_actions <= n_numbers,
        "observation_space": n_observations <= n_numbers,
        "step": 0 <= step < 2**31 and size > 0 and step % size == 0 and arrays["run/step"].tolist() == [step],
        "log_interval": settings["log_interval"] > 0,
        "n_predictions": 0 <= settings["n_predictions"] < 2**32,
        "n_steps": size < 2**31,
        "n_envs": length is None or length.shape == (1, config["n_envs"]),
        "n_bins": n_actions * config["n_bins"] <= max(n_numbers, MAX_BINS),
        **{name: _is_of_size(size, arrays, n_numbers) for name, size in _sizes(config).items()},
    }


def _sizes(config: Settings) -> dict[str, int | list[int]]:
    """The settings of the network that say how many units, blocks or layers it has."""
    own = settings_of(NETWORKS[config["network"]])
    return {name: size for name, size in config.items() if name in own and isinstance(size, int | list)}


def _is_of_size(size: int | list[int], arrays: dict[str, np.ndarray], n_numbers: int) -> bool:
    """Whether a file of these arrays may call for a network of this size."""
    return size <= n_numbers if isinstance(size, int) else len(size) <= len(arrays) and sum(size) <= n_numbers


def words_of(settings: Settings) -> Fields:
    """The words of the agent in checked settings."""
    return {**settings["config"], **settings["hypers"]}


def _check_like(name: str, given: object, like: object) -> None:
    """Raise unless given has the types and keys of like."""
    if like is not None and type(given) is not type(like):
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
    sizes: dict[str, Callable[[], int]] = {
        "Box": lambda: math.prod(content[2]),
        "Discrete": lambda: content[0],
        "MultiDiscrete": lambda: sum(np.array(content[0], object).ravel().tolist()),  # without overflow
        "MultiBinary": lambda: math.prod(content) if isinstance(content, list) else content,
    }
    size = sizes[kind]()
    if size < 0:
        raise CheckpointError(f"a space is {shown(record)}, of negative size")
    return size
