"""Environments in JAX of other libraries by name: "gymnax:Pendulum-v1", "brax:ant", "mjx:HalfCheetah"."""

import functools
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from galton.envs.brax_like import BraxLike, of_brax
from galton.envs.gymnax_record import Gymnax
from galton.errors import UsageError, did_you_mean, require, require_integer
from galton.extras import needed


def make(name: str, **options: Any) -> Any:
    """The record of a task of another library, such as "brax:ant".

    Args:
        name: the library, a colon, and the task's name there.
        options: `max_episode_steps`; `observation`, a key, where observations are a dictionary; and what the library
            takes: of gymnax the task's parameters, of Brax such as `backend`, of Playground what its configuration has.

    Raises:
        UsageError: a name or an option that the library does not know, or a task that Galton can't act in.
        MissingExtraError: the library is not installed.
    """
    library, _, task = name.partition(":")
    require_integer("max_episode_steps", options.get("max_episode_steps", 1), 1)
    try:
        hash(tuple(options.values()))
    except TypeError:
        raise UsageError(f"env_kwargs is {options} for {name!r}; give numbers, texts and tuples of them") from None
    with needed(f"environment {name!r}", MODULES.get(library, library)):
        return MAKERS[library](task, **dict(sorted(options.items())))


def _known(library: str, task: str, names: Sequence[str]) -> None:
    told = did_you_mean(task, names) or f"; it has {', '.join(sorted(names))}"
    require(task in names, f"environment is '{library}:{task}', and {library} has no task {task!r}{told}")


def _made(name: str, maker: Callable[[], Any]) -> Any:
    """Make it by the library, whose errors are told with the name."""
    try:
        return maker()
    except (TypeError, ValueError, KeyError, AttributeError, FileNotFoundError) as error:
        raise UsageError(f"environment {name!r} can't be made: {type(error).__name__}: {error}") from error


@functools.cache
def _gymnax(task: str, /, max_episode_steps: int | None = None, **constants: Any) -> Gymnax:
    import gymnax

    name = f"gymnax:{task}"
    _known("gymnax", task, gymnax.registered_envs)
    env, usual = gymnax.make(task)
    params = _made(name, lambda: usual.replace(**constants))
    limit = int(params.max_steps_in_episode) if max_episode_steps is None else max_episode_steps
    space, own = env.action_space(params), params.replace(max_steps_in_episode=limit)
    kind = type(space).__name__
    require(kind in ("Box", "Discrete"), f"environment {name!r} has actions {kind}; Galton acts in Box and Discrete")
    if kind == "Discrete":
        return Gymnax(env, own, name, limit, int(space.n))
    bounds = (np.broadcast_to(np.asarray(bound, float), space.shape).ravel() for bound in (space.low, space.high))
    return Gymnax(env, own, name, limit, 0, tuple(space.shape), *(tuple(map(float, bound)) for bound in bounds))


@functools.cache
def _brax(task: str, /, max_episode_steps: int = 1000, observation: str | None = None, **own: Any) -> BraxLike:
    from brax import envs

    name = f"brax:{task}"
    _known("brax", task, [*envs._envs])
    return of_brax(_made(name, lambda: envs.get_environment(task, **own)), name, max_episode_steps, observation)


@functools.cache
def _playground(
    task: str, /, max_episode_steps: int | None = None, observation: str | None = None, **own: Any
) -> BraxLike:
    from mujoco_playground import registry

    name = f"playground:{task}"
    _known("playground", task, registry.ALL_ENVS)
    usual = own.get("episode_length", registry.get_default_config(task).episode_length)
    limit = usual if max_episode_steps is None else max_episode_steps
    env = _made(name, lambda: registry.load(task, config_overrides={"impl": "jax"} | own))
    return of_brax(env, name, limit, observation)


@functools.cache
def _mjx(task: str, /, max_episode_steps: int = 1000, **own: Any) -> BraxLike:
    from galton.envs.mjx import TASKS, Runner

    _known("mjx", task, TASKS)
    require(not own, f"env_kwargs has {', '.join(own)} for 'mjx:{task}', which takes max_episode_steps alone")
    return of_brax(Runner(task), f"mjx:{task}", max_episode_steps)


MODULES = {"playground": "mujoco_playground", "mjx": "mujoco.mjx"}
"""The modules of libraries that have other names."""
MAKERS: dict[str, Callable[..., Any]] = {"gymnax": _gymnax, "brax": _brax, "playground": _playground, "mjx": _mjx}
"""The libraries whose tasks go by library:task."""
