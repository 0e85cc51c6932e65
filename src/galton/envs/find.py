"""The task that a user means: by a name, an id, a function, or an environment that is already there."""

import contextlib
import sys
from typing import Any, cast

import gymnasium
from gymnasium.envs.registration import find_highest_version, get_env_id, parse_env_id

from galton.envs import registry
from galton.envs.base import Environment, missing
from galton.envs.host.answers import shown
from galton.envs.host.gymnasium import GymnasiumTask
from galton.envs.host.vector import VectorTask
from galton.envs.jax_task import JaxTask, check
from galton.envs.task import Task
from galton.errors import UsageError, did_you_mean, require
from galton.extras import check_named, is_instance_of, needed, require_libraries


def find(env: object, **kwargs: Any) -> Task:
    """The task of whatever a user gives: a name, an id, an environment, a function that makes one.

    Args:
        env: a name in ENVS, a Gymnasium id (also `module:Id`), `module:Class`, a function that makes a Gymnasium
            environment, a Gymnasium environment or vector environment, an SB3 VecEnv, a record in pure JAX, or what
            this made.
        kwargs: the constants of a name or an id, and what a class or a function is called with; of any of them
            `action_scale` makes the box that policies see so many times as large, and what is done there the action
            over it.

    Raises:
        UsageError: something else, or an environment that Galton can't use, with the reason.
    """
    if isinstance(env, str):
        return _find_by_name(env, kwargs)
    is_record = not missing(env) and type(env).__hash__ is not None
    if callable(env) and not (is_record or isinstance(env, Task | gymnasium.Env)):
        return GymnasiumTask(env, **kwargs)
    require(not kwargs, f"env_kwargs is {kwargs}; it goes with what makes an environment, not with one that is there")
    if is_record or isinstance(env, Task):
        require(not isinstance(env, type), f"env is {shown(env)}, a class; give what it makes, by calling it")
        if not is_record:
            return cast("Task", env)
        task = JaxTask(cast("Environment", env))
        check(task)
        return task
    if isinstance(env, gymnasium.vector.VectorEnv) or is_instance_of(env, "stable_baselines3", "VecEnv"):
        return VectorTask(env)
    if isinstance(env, gymnasium.Env):
        return GymnasiumTask(env)
    _refuse_unfinished(env)
    raise UsageError(
        f"env is {shown(env)}; give a Gymnasium id, an environment, a function that makes one, or a name: "
        f"{', '.join(registry.ENVS)}"
    )


def _find_by_name(name: str, kwargs: dict[str, Any]) -> Task:
    if registry.is_known(name) or name.partition(":")[0] in registry.LIBRARIES:
        scale = kwargs.pop("action_scale", 1.0)
        return JaxTask(registry.make(name, **kwargs), scale)
    _refuse_unversioned(name)
    module, _, maker = name.partition(":")
    plain = module.removesuffix(".py").replace("/", ".")
    require(not (maker and module.endswith(".py")), f"environment is {name!r}; give it as {plain}:{maker}")
    try:
        return _find_mujoco(name, kwargs) or GymnasiumTask(name, **kwargs)
    except UsageError as error:
        if isinstance(error.__cause__, gymnasium.error.UnregisteredEnv):
            raise UsageError(f"environment is {name!r}; {_why_unknown(name, error.__cause__)}") from error
        if isinstance(error.__cause__, gymnasium.error.DependencyNotInstalled) and _comes_from(name, "box2d"):
            require_libraries(f"environment {name!r}", "Box2D")
            check_named(f"environment {name!r}", error)
        raise


def _refuse_unversioned(name: str) -> None:
    """Raise UsageError for an id without its version, of which Gymnasium would take the newest."""
    if name in gymnasium.registry or ":" in name:
        return
    with contextlib.suppress(gymnasium.error.Error):
        namespace, plain, version = parse_env_id(name)
        newest = None if version is not None else find_highest_version(namespace, plain)
        meant = None if newest is None else get_env_id(namespace, plain, newest)
        require(meant is None, f"environment is {name!r}, an id without its version; {meant!r} is the newest")


def _why_unknown(name: str, error: gymnasium.error.UnregisteredEnv) -> str:
    """A sentence that there is no such id, with what was probably meant: Gymnasium's guess is without the version."""
    module, _, maker = name.partition(":")
    if maker.isidentifier() and (there := sys.modules.get(module)):
        makers = [key for key, one in vars(there).items() if callable(one) and not key.startswith("_")]
        return f"module {module} has no {maker}{did_you_mean(maker, makers) or ', nor has Gymnasium such an id'}"
    known = f"Gymnasium knows no environment of that name, and Galton's own are {', '.join(registry.ENVS)}"
    own = "" if maker else "; one of a module of yours is module:Class, or module:Id if it is registered"
    meant = did_you_mean(name, [*registry.ENVS, *gymnasium.registry])
    told = str(error).partition(" Did you mean")[0] if meant else str(error)
    return f"{known}{own}. {told.rstrip('.')}{meant}"


def _comes_from(name: str, package: str) -> bool:
    """True if Gymnasium has the environment of that id in this package of its environments."""
    spec = gymnasium.registry.get(name)
    return spec is not None and str(spec.entry_point).startswith(f"gymnasium.envs.{package}.")


def _find_mujoco(name: str, kwargs: dict[str, Any]) -> Task | None:
    if not _comes_from(name, "mujoco"):
        return None
    with needed(f"environment {name!r}", "mujoco", "imageio"):  # which Gymnasium imports with it
        from galton.envs.host.mujoco import MujocoTask
        from galton.envs.host.mujoco_functions import MUJOCO_FUNCTIONS
    return MujocoTask(name, **kwargs) if name in MUJOCO_FUNCTIONS else None


def _refuse_unfinished(env: object) -> None:
    """Name what a record of the user's own still needs; one with `reset` and `step` alone may be of any library."""
    has = {name for name in vars(Environment) if not name.startswith("_") and hasattr(env, name)}
    if has <= {"reset", "step"}:
        return
    lacking = missing(env)
    record = f"env is {shown(env)}, a record that"
    if lacking:
        remedy = "give it all of galton.envs.Environment; a return that is not known is None"
        raise UsageError(f"{record} lacks {', '.join(lacking)}; {remedy}")
    if type(env).__hash__ is None:
        raise UsageError(f"{record} can't be hashed, as a key of compiled programs must be; make it a frozen dataclass")
