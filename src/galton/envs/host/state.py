"""The state of one Gymnasium environment as arrays: its own, its wrappers' and its generator's.

Of Gymnasium's wrappers only those that stand here are known, by their very class: any other wrapper counts as one that
keeps a state nobody can tell.
"""

import json
import operator
from typing import Any

import gymnasium
import numpy as np
from gymnasium import wrappers
from gymnasium.wrappers import TimeLimit
from jaxtyping import UInt8

from galton.envs.host.answers import as_numbers, blame, shown
from galton.errors import BrokenEnvironmentError

Env = gymnasium.Env[Any, Any]
"""A Gymnasium environment, whatever it observes and takes."""
State = dict[str, np.ndarray]


_STATELESS = (
    "ClipAction",
    "ClipReward",
    "DtypeObservation",
    "FilterObservation",
    "FlattenObservation",
    "GrayscaleObservation",
    "OrderEnforcing",
    "PassiveEnvChecker",
    "RecordEpisodeStatistics",  # what it counts is told in infos, which training does not read
    "RecordVideo",
    "RepeatAction",
    "RescaleAction",
    "RescaleObservation",
    "ReshapeObservation",
    "ResizeObservation",
)
"""Wrappers of Gymnasium's whose observations, rewards and ends do not depend on earlier steps."""

_ATTRIBUTES = {
    "NormalizeObservation": ("obs_rms.mean", "obs_rms.var", "obs_rms.count"),
    "NormalizeReward": ("return_rms.mean", "return_rms.var", "return_rms.count", "discounted_reward"),
    "TimeAwareObservation": ("timesteps",),
}
"""Wrappers of Gymnasium's with a state, and the attributes that are all of it."""


def is_restorable(env: Env) -> bool:
    """True if all of an environment can be saved: its own state and that of every wrapper around it."""
    return _tells(env.unwrapped) and all(
        type(wrapper) is TimeLimit
        or _tells(wrapper)
        or is_monitor(wrapper)
        or _name(wrapper) in (*_STATELESS, *_ATTRIBUTES)
        for wrapper in _around(env)
    )


def get_state(env: Env, where: str) -> State:
    """All of a restorable environment that decides how it goes on."""
    state = _told(env.unwrapped, "state", where)
    for prefix, wrapper in _named(env):
        state |= _told(wrapper, prefix, where) if _tells(wrapper) else _prefixed(prefix, _known_state(wrapper))
    state["elapsed_steps"] = np.array([limit._elapsed_steps or 0 for limit in _time_limits(env)], np.int64)
    with blame(f"{where}: np_random"):
        state["generator"] = generator_state(env.unwrapped.np_random)
    return state


def set_state(env: Env, state: dict[str, Any], where: str) -> None:
    """Put a restorable environment, which was reset, into what `get_state` told."""
    for prefix, holder in (("state", env.unwrapped), *_named(env)):
        own = {key.removeprefix(f"{prefix}/"): value for key, value in state.items() if key.startswith(f"{prefix}/")}
        with blame(f"{where}: set_state"):
            if isinstance(holder, gymnasium.Wrapper) and not _tells(holder):
                _set_known_state(holder, own)
            else:
                holder.set_state(own)
    for limit, elapsed in zip(_time_limits(env), state["elapsed_steps"], strict=True):
        limit._elapsed_steps = int(elapsed)
    set_generator_state(env.unwrapped.np_random, state["generator"])


def generator_state(generator: np.random.Generator) -> UInt8[np.ndarray, " n"]:
    """A generator's state as bytes of JSON, for a checkpoint."""
    text = json.dumps(generator.bit_generator.state, default=np.ndarray.tolist).encode()
    return np.frombuffer(text.ljust(max(512, 2 ** (len(text) - 1).bit_length())), np.uint8)


def set_generator_state(generator: np.random.Generator, state: UInt8[np.ndarray, " n"]) -> None:
    """Put a generator into the state that `generator_state` told."""
    generator.bit_generator.state = json.loads(state.tobytes())


def _told(holder: Any, prefix: str, where: str) -> State:
    """The state that `get_state` of an environment or a wrapper tells, checked."""
    with blame(f"{where}: get_state"):
        told: object = holder.get_state()
    if not isinstance(told, dict):
        raise BrokenEnvironmentError(f"{where}: get_state returned {shown(told)}, not a dict of arrays")
    state = {}
    for key, value in told.items():
        numbers = as_numbers(value)
        if numbers is None:
            raise BrokenEnvironmentError(f"{where}: get_state's {key!r} is {shown(value)}, not numbers")
        state[key] = numbers
    return _prefixed(prefix, state)


def _prefixed(prefix: str, state: State) -> State:
    return {f"{prefix}/{key}": value for key, value in state.items()}


def _tells(env: Any) -> bool:
    """True if the class of an environment or a wrapper tells a state, its own and not one that it forwards."""
    return all(callable(getattr(type(env), name, None)) for name in ("get_state", "set_state"))


def _named(env: Env) -> list[tuple[str, Any]]:
    """The wrappers around an environment but for time limits, each with the beginning of its arrays' names."""
    named = [(f"wrapper/{i}/{type(wrapper).__name__}", wrapper) for i, wrapper in enumerate(_around(env))]
    return [(name, wrapper) for name, wrapper in named if type(wrapper) is not TimeLimit]


def _time_limits(env: Env) -> list[Any]:
    return [wrapper for wrapper in _around(env) if isinstance(wrapper, TimeLimit)]


def _around(env: Env) -> list[Any]:
    found = []
    while env is not env.unwrapped:
        found.append(env)
        env = env.env  # type: ignore[attr-defined]
    return found


def is_monitor(env: object) -> bool:
    """True for SB3's Monitor, which tells of episodes in infos and changes nothing else."""
    kind = type(env)
    return (kind.__module__, kind.__name__) == ("stable_baselines3.common.monitor", "Monitor")


def _known_state(wrapper: Any) -> dict[str, np.ndarray]:
    """The state of a known wrapper, which may be empty."""
    names = _ATTRIBUTES.get(_name(wrapper), ())
    return {name: np.array(operator.attrgetter(name)(wrapper)) for name in names}


def _set_known_state(wrapper: Any, state: dict[str, Any]) -> None:
    """Put a known wrapper into what `_known_state` told."""
    for name in _ATTRIBUTES.get(_name(wrapper), ()):
        *path, last = name.split(".")
        put(operator.attrgetter(*path)(wrapper) if path else wrapper, last, state[name])


def put(holder: Any, name: str, value: Any) -> None:
    """Set an array or a number of Python's, which stays one: numpy's would decide on the precision of products."""
    plain = not isinstance(getattr(holder, name), np.ndarray | np.generic)
    setattr(holder, name, np.asarray(value).item() if plain else np.array(value))


def _name(wrapper: Any) -> str:
    """The name under which Gymnasium offers a wrapper; empty for any other, a subclass of its own included."""
    name = type(wrapper).__name__
    return name if vars(wrappers).get(name) is type(wrapper) else ""
