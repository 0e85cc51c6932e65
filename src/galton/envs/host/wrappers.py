"""Gymnasium's wrappers: which of them keep a state, and what it is.

Only what stands here is known, by its very class: any other wrapper counts as one that keeps a state nobody can tell.
"""

import operator
from typing import Any

import gymnasium
import numpy as np
from gymnasium import wrappers

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

Wrapper = gymnasium.Wrapper[Any, Any, Any, Any]


def is_known(wrapper: Wrapper) -> bool:
    """Whether all of a wrapper's state can be told, or it has none."""
    return is_monitor(wrapper) or _name(wrapper) in (*_STATELESS, *_ATTRIBUTES)


def is_monitor(env: object) -> bool:
    """Whether it is SB3's Monitor, which tells of episodes in infos and changes nothing else."""
    kind = type(env)
    return (kind.__module__, kind.__name__) == ("stable_baselines3.common.monitor", "Monitor")


def get_state(wrapper: Wrapper) -> dict[str, np.ndarray]:
    """The state of a known wrapper, which may be empty."""
    names = _ATTRIBUTES.get(_name(wrapper), ())
    return {name: np.array(operator.attrgetter(name)(wrapper)) for name in names}


def set_state(wrapper: Wrapper, state: dict[str, Any]) -> None:
    """Put a known wrapper into what `get_state` told."""
    for name in _ATTRIBUTES.get(_name(wrapper), ()):
        *path, last = name.split(".")
        put(operator.attrgetter(*path)(wrapper) if path else wrapper, last, state[name])


def put(holder: Any, name: str, value: Any) -> None:
    """Set an array or a number of Python's, which stays one: numpy's would decide on the precision of products."""
    plain = not isinstance(getattr(holder, name), np.ndarray | np.generic)
    setattr(holder, name, np.asarray(value).item() if plain else np.array(value))


def _name(wrapper: Wrapper) -> str:
    """The name under which Gymnasium offers a wrapper; empty for any other, a subclass of its own included."""
    name = type(wrapper).__name__
    return name if vars(wrappers).get(name) is type(wrapper) else ""
