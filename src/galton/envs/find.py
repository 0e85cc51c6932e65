"""What a user calls an environment, found."""

from typing import Any

import gymnasium

from galton.envs import registry
from galton.envs.base import Environment
from galton.envs.gym import GymnasiumTask
from galton.envs.host.answers import shown
from galton.envs.host.base import HostTask
from galton.envs.vector import VectorTask, is_sb3
from galton.errors import UsageError


def find(env: Any, **kwargs: Any) -> Environment | HostTask:
    """One of our records, or a task outside JAX.

    Args:
        env: a name in ENVS, a Gymnasium id (also `module:Id`), a function that makes a Gymnasium environment,
            a Gymnasium environment or vector environment, an SB3 VecEnv, one of our records, or a task.
        kwargs: the constants of a name or an id.

    Raises:
        UsageError: something else, or an environment that Galton can't use, with the reason.
    """
    if isinstance(env, str):
        if registry.is_known(env):
            return registry.make(env, **kwargs)
        try:
            return _find_mujoco(env, kwargs) or GymnasiumTask(env, **kwargs)
        except UsageError as error:
            if isinstance(error.__cause__, gymnasium.error.UnregisteredEnv):
                known = f"Gymnasium knows no environment of that name, and Galton's own are {', '.join(registry.ENVS)}"
                raise UsageError(f"environment is {env!r}; {known}. {error.__cause__}") from error
            raise
    if kwargs:
        raise UsageError(f"env_kwargs is {kwargs}; it goes with a name or an id, not with an environment that is there")
    if isinstance(env, Environment | HostTask):
        return env
    if isinstance(env, gymnasium.vector.VectorEnv) or is_sb3(env):
        return VectorTask(env)
    if isinstance(env, gymnasium.Env) or callable(env):
        return GymnasiumTask(env)
    raise UsageError(
        f"env is {shown(env)}; give a Gymnasium id, an environment, a function that makes one, or a name: "
        f"{', '.join(registry.ENVS)}"
    )


def _find_mujoco(name: str, kwargs: dict[str, Any]) -> HostTask | None:
    """The batched task of that id, if there is one."""
    spec = gymnasium.registry.get(name)
    if spec is None or not str(spec.entry_point).startswith("gymnasium.envs.mujoco."):
        return None
    try:
        from galton.envs.host.mujoco_functions import MUJOCO_FUNCTIONS
        from galton.envs.mujoco import MujocoTask
    except ImportError as error:
        raise UsageError(f"environment {name!r} needs MuJoCo: pip install 'galton[mujoco]' ({error})") from None
    return MujocoTask(name, **kwargs) if name in MUJOCO_FUNCTIONS else None
