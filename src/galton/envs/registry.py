"""Our own environments by name. Importing this costs no JAX: records load when they are made."""

import dataclasses
import importlib
import json
from typing import TYPE_CHECKING, NamedTuple, cast

import gymnasium

from galton.errors import UsageError, require_word

if TYPE_CHECKING:
    from galton.envs.base import Environment


LIBRARIES = ("gymnax", "brax", "playground", "mjx")
"""Other libraries whose environments in JAX go by library:task (`galton.envs.others`)."""


class Entry(NamedTuple):
    """An entry of ENVS, which is known before the environment's record is loaded."""

    record: str
    """module:Class of the environment's record."""
    gymnasium_id: str
    max_episode_steps: int


ENVS = {
    "bandit": Entry("galton.envs.bandit:Bandit", "galton/Bandit-v0", max_episode_steps=1),
    "lqr": Entry("galton.envs.lqr:LQR", "galton/LQR-v0", max_episode_steps=100),
    "mountain-car": Entry(
        "galton.envs.mountain_car:MountainCar", "galton/MountainCarContinuous-v0", max_episode_steps=999
    ),
    "acrobot": Entry("galton.envs.acrobot:Acrobot", "galton/AcrobotContinuous-v0", max_episode_steps=500),
    "drifting-bandit": Entry("galton.envs.changing:DriftingBandit", "galton/DriftingBandit-v0", max_episode_steps=1),
    "switching-lqr": Entry("galton.envs.changing:SwitchingLQR", "galton/SwitchingLQR-v0", max_episode_steps=100),
    "xor-bandit": Entry("galton.envs.correlated:XorBandit", "galton/XorBandit-v0", max_episode_steps=1),
    "ridge-bandit": Entry("galton.envs.correlated:RidgeBandit", "galton/RidgeBandit-v0", max_episode_steps=1),
}
"""Our own environments, by the names that commands and `make` take; each is registered with Gymnasium too."""


def module_of(env: str) -> tuple[str, ...]:
    """The module of an environment that is called `module:Id`, in a tuple; none of others, or of a JAX library's."""
    module, colon, _ = env.partition(":")
    return (module,) if colon and module not in LIBRARIES else ()


def key_of(name: str) -> str:
    """The key in ENVS of one of our own environments, by either of its names; any other name as it is."""
    return next((key for key, entry in ENVS.items() if name in (key, entry.gymnasium_id)), name)


def is_known(name: str) -> bool:
    """True if it is a name of one of our own environments."""
    return key_of(name) in ENVS


def make(name: str, **constants: object) -> "Environment":
    """The environment of that name, with other constants than its defaults where given; a list is as good as a tuple.

    A task of another library goes by library:task.

    Raises:
        UsageError: an unknown name, an unknown constant or one out of range.
    """
    if name.partition(":")[0] in LIBRARIES:
        given = {constant: _tuples(value) for constant, value in constants.items()}
        return cast("Environment", importlib.import_module("galton.envs.others").make(name, **given))
    key = key_of(name)
    require_word("environment", key, ENVS)
    module, record = ENVS[key].record.split(":")
    cls = getattr(importlib.import_module(module), record)
    known = [field.name for field in dataclasses.fields(cls)]
    for constant in constants:
        if constant not in known:
            raise UsageError(f"{name} has no constant {constant!r}; it has {', '.join(known) or 'none'}")
    try:
        env: Environment = cls(**{constant: _tuples(value) for constant, value in constants.items()})
    except (TypeError, ValueError) as error:
        if isinstance(error, UsageError):
            raise
        raise UsageError(f"{name} can't be made with {constants}: {error}") from None
    return env


def read_constants(text: str) -> dict[str, object]:
    """An environment's keyword arguments from JSON, with tuples for lists; UsageError for anything but an object."""
    try:
        constants = json.loads(text)
    except (ValueError, RecursionError) as error:
        like = """write it like '{"g": 9.81}'"""
        raise UsageError(f"env_kwargs is {text[:200]!r}, which is not JSON: {error}; {like}") from None
    if not isinstance(constants, dict):
        raise UsageError(f"env_kwargs is {text[:200]!r}; it must be a JSON object")
    return {name: _tuples(value) for name, value in constants.items()}


def _tuples(value: object) -> object:
    return tuple(map(_tuples, value)) if isinstance(value, list) else value


def register_with_gymnasium() -> None:
    """Make every task available to gymnasium.make, and the robots that change (`galton.envs.host.gears`)."""
    for key, task in ENVS.items():
        gymnasium.register(
            task.gymnasium_id,
            entry_point="galton.envs.as_gymnasium:GymnasiumEnv",
            max_episode_steps=task.max_episode_steps,
            kwargs={"task": key},
        )
    for robot in ("HalfCheetah", "Ant"):
        gymnasium.register(
            f"galton/{robot}Gears-v0",
            entry_point="galton.envs.host.gears:Gears",
            max_episode_steps=1_000,
            kwargs={"robot": f"{robot}-v5"},
        )
