"""The wrappers around an environment, and the copies in a vector environment."""

from typing import Any

import gymnasium
from gymnasium.wrappers import TimeLimit

from galton.envs.host.state import is_monitor
from galton.extras import is_instance_of

Layers = list[Any]
"""An environment's wrappers from the outside in, and the environment; of one in a vector environment, that's first."""


def layers_of(env: Any) -> Layers:
    """The wrappers around an environment or a vector environment from the outside in, and what they are around."""
    found = [env]
    while isinstance(found[-1], gymnasium.Wrapper | gymnasium.vector.VectorWrapper) or is_sb3_wrapper(found[-1]):
        found.append(below(found[-1]))
    return [layer for layer in found if not is_monitor(layer)]


def layers_of_copies(envs: Any) -> list[Layers]:
    """For each copy in a vector environment of this process the layers that all share, and then its own."""
    shared = layers_of(envs)
    copies = copies_in(shared[-1])
    return [[*shared, *layers_of(one)] for one in copies] if copies else [shared] * envs.num_envs


def copies_in(envs: Any) -> list[gymnasium.Env[Any, Any]]:
    """The environments of this process that a vector environment holds as its `envs`; none where it holds no such."""
    found: Any = getattr(envs, "envs", None)
    own = isinstance(found, list | tuple) and all(isinstance(one, gymnasium.Env) for one in found)
    return list(found) if own else []


def has_no_limit(layers: Layers) -> bool:
    """True if an environment of this process has no time limit that Gymnasium knows of."""
    known = any(isinstance(layer, TimeLimit) for layer in layers)
    return isinstance(layers[-1], gymnasium.Env) and not known


def is_sb3_wrapper(env: Any) -> bool:
    """True for a wrapper around one of SB3's vector environments."""
    return is_instance_of(env, "stable_baselines3", "VecEnvWrapper")


def below(wrapper: Any) -> Any:
    """What a wrapper is around."""
    return wrapper.venv if is_sb3_wrapper(wrapper) else wrapper.env
