"""The state of one Gymnasium environment as arrays: its own, its time limits' and its generator's."""

import json
from typing import Any, Protocol, runtime_checkable

import gymnasium
import numpy as np
from gymnasium.wrappers import TimeLimit
from jaxtyping import UInt8

from galton.envs.host.answers import as_numbers, blame, shown
from galton.errors import BrokenEnvironmentError

Env = gymnasium.Env[Any, Any]
"""A Gymnasium environment, whatever it observes and takes."""


@runtime_checkable
class Restorable(Protocol):
    """An environment that tells its state and can be put back into it."""

    def get_state(self) -> dict[str, Any]:
        """Arrays or numbers by name, always of the same shapes."""

    def set_state(self, state: dict[str, Any]) -> None:
        """Go on from what `get_state` told."""


def get_state(env: Env, where: str) -> dict[str, np.ndarray]:
    """All of a Restorable environment that decides how it goes on."""
    assert isinstance(env.unwrapped, Restorable)
    with blame(f"{where}: get_state"):
        told: object = env.unwrapped.get_state()
    if not isinstance(told, dict):
        raise BrokenEnvironmentError(f"{where}: get_state returned {shown(told)}, not a dict of arrays")
    state = {}
    for key, value in told.items():
        numbers = as_numbers(value)
        if numbers is None:
            raise BrokenEnvironmentError(f"{where}: get_state's {key!r} is {shown(value)}, not numbers")
        state[f"state/{key}"] = numbers
    state["elapsed_steps"] = np.array([limit._elapsed_steps or 0 for limit in _time_limits(env)], np.int64)
    with blame(f"{where}: np_random"):
        state["generator"] = generator_state(env.unwrapped.np_random)
    return state


def set_state(env: Env, state: dict[str, Any], where: str) -> None:
    """Put a Restorable environment, which was reset, into what `get_state` told."""
    assert isinstance(env.unwrapped, Restorable)
    own = {key.removeprefix("state/"): value for key, value in state.items() if key.startswith("state/")}
    with blame(f"{where}: set_state"):
        env.unwrapped.set_state(own)
    for limit, elapsed in zip(_time_limits(env), state["elapsed_steps"], strict=True):
        limit._elapsed_steps = int(elapsed)
    set_generator_state(env.unwrapped.np_random, state["generator"])


def generator_state(generator: np.random.Generator) -> UInt8[np.ndarray, " n"]:
    """A generator's state as bytes of JSON, for a checkpoint."""
    text = json.dumps(generator.bit_generator.state, default=np.ndarray.tolist)
    return np.frombuffer(text.encode().ljust(512), np.uint8)


def set_generator_state(generator: np.random.Generator, state: UInt8[np.ndarray, " n"]) -> None:
    """Put a generator into the state that `generator_state` told."""
    generator.bit_generator.state = json.loads(state.tobytes())


def _time_limits(env: Env) -> list[Any]:
    """The TimeLimit wrappers around an environment, from the outside in."""
    found = []
    while env is not env.unwrapped:
        if isinstance(env, TimeLimit):
            found.append(env)
        env = env.env  # type: ignore[attr-defined]
    return found
