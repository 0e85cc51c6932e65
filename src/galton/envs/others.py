"""Environments in JAX of other libraries, as records: gymnax's, Brax's and MuJoCo Playground's, and any like Brax's."""

import copy
import dataclasses
import functools
from collections.abc import Callable, Hashable, Mapping, Sequence
from typing import Any, ClassVar

import jax
import jax.numpy as jnp
import numpy as np
from gymnasium import spaces
from jax.interpreters.partial_eval import dce_jaxpr
from jaxtyping import Array, Bool, Float, Key, PyTree

from galton.envs.base import box
from galton.errors import UsageError, did_you_mean, require
from galton.extras import needed

ENDLESS = 2**30
"""Steps of an episode that no time limit cuts off."""


@jax.tree_util.register_pytree_node_class
class Held:
    """An environment of another library, whose JAX arrays are leaves and so arguments of programs.

    As constants of a program they would make its compilation slow; and arrays that were computed on a GPU differ in
    their last bits from process to process, so that no compiled program would be found again.
    """

    def __init__(self, env: Any, first: "Held | None" = None) -> None:
        self.env, self._first = env, first or self

    def tree_flatten(self) -> tuple[list[Array], Hashable]:
        """The arrays, and the environment that they are from."""
        return [leaf for leaf in jax.tree.leaves(vars(self.env)) if isinstance(leaf, jax.Array)], self._first

    @classmethod
    def tree_unflatten(cls, first: "Held", arrays: Sequence[Any]) -> "Held":
        """The same environment with these arrays."""
        given = iter(arrays)
        leaves, structure = jax.tree.flatten(vars(first.env))
        filled = [next(given) if isinstance(leaf, jax.Array) else leaf for leaf in leaves]
        env = copy.copy(first.env)
        vars(env).update(jax.tree.unflatten(structure, filled))
        return cls(env, first)


@dataclasses.dataclass(frozen=True)
class Kept:
    """The leaves of a library's state that are carried from step to step: what a step reads, and what a policy sees."""

    structure: Any
    shapes: tuple[jax.ShapeDtypeStruct, ...]
    """Of all leaves."""
    places: tuple[int, ...]
    """The leaves that are carried, by their places among all."""

    def taken(self, state: PyTree[Array]) -> tuple[Array, ...]:
        """The leaves that are carried, in the types that a first state has."""
        leaves = jax.tree.leaves(state)
        return tuple(jnp.asarray(leaves[i], self.shapes[i].dtype) for i in self.places)

    def whole(self, leaves: Sequence[Array]) -> PyTree[Array]:
        """The state, with zeros for what no step reads."""
        found = dict(zip(self.places, leaves, strict=True))
        filled = [found.get(i, jnp.zeros(each.shape, each.dtype)) for i, each in enumerate(self.shapes)]
        return jax.tree.unflatten(self.structure, filled)


def _kept(env: Any) -> Kept:
    """Find what the rewards, ends and observations of all steps to come depend on, in the program of one step."""
    state = jax.eval_shape(env.reset, jax.random.PRNGKey(0))
    shapes, structure = jax.tree.flatten(state)
    at_obs, at_reward, at_done = (_places(state, name) for name in ("obs", "reward", "done"))
    action = jax.ShapeDtypeStruct((env.action_size,), jnp.float32)

    def step(action: Array, *leaves: Array) -> list[Array]:
        return jax.tree.leaves(env.step(jax.tree.unflatten(structure, leaves), action))

    program = jax.make_jaxpr(step)(action, *shapes).jaxpr
    kept, read = set[int](), {*at_obs, *_places(state, "metrics")}
    while not read <= kept:
        kept |= read
        wanted = kept.union(at_reward, at_done)
        _, used = dce_jaxpr(program, [i in wanted for i in range(len(shapes))])
        read = {i for i, is_used in enumerate(used[1:]) if is_used}
    return Kept(structure, tuple(shapes), tuple(sorted(kept)))


def _places(state: Any, name: str) -> list[int]:
    """The places of one field's leaves among all leaves of a state."""
    numbers = jax.tree.unflatten(jax.tree.structure(state), range(len(jax.tree.leaves(state))))
    found: list[int] = jax.tree.leaves(getattr(numbers, name))
    return found


@dataclasses.dataclass(frozen=True)
class BraxLike:
    """An environment whose `reset(key)` and `step(state, action)` return a state with obs, reward and done.

    That is the protocol of Brax and Playground. The environment is the bare one, without wrappers: time limits and new
    episodes are Galton's own, so that the last observation of an episode is never lost.
    """

    held: Held
    name: str
    max_episode_steps: int
    kept: Kept
    part: str | None = None
    """The key of what the policy sees, where observations are a dictionary."""

    resets_slowly: ClassVar[bool] = True
    """True: a physics engine's first state may cost as much as many steps."""
    optimal_return: ClassVar[float | None] = None
    random_return: ClassVar[float | None] = None

    def __repr__(self) -> str:
        return self.name

    @property
    def action_low(self) -> Float[np.ndarray, " d"]:
        """−1, as both libraries have it."""
        return -self.action_high

    @property
    def action_high(self) -> Float[np.ndarray, " d"]:
        """1, as both libraries have it."""
        return box(1, self.held.env.action_size)

    @property
    def observation_low(self) -> Float[np.ndarray, " o"]:
        """No bound."""
        return -self.observation_high

    @property
    def observation_high(self) -> Float[np.ndarray, " o"]:
        """No bound."""
        return box(np.inf, jax.eval_shape(lambda key: self.observe(self.reset(key)), jax.random.key(0)).size)

    def reset(self, key: Key[Array, ""]) -> tuple[Array, ...]:
        """A first state."""
        return self.kept.taken(self.held.env.reset(jax.random.key_data(key)))

    def noise(self, key: Key[Array, ""]) -> tuple[()]:
        """Nothing: a state holds the key of what is random."""
        del key
        return ()

    def step(
        self, state: tuple[Array, ...], action: Float[Array, " d"], noise: tuple[()]
    ) -> tuple[tuple[Array, ...], Float[Array, ""], Bool[Array, ""]]:
        """One step of the bare environment."""
        del noise
        after = self.held.env.step(self.kept.whole(state), action)
        return self.kept.taken(after), jnp.asarray(after.reward, float), after.done > 0.5

    def observe(self, state: tuple[Array, ...]) -> Float[Array, " o"]:
        """The observation that the policy sees, flat."""
        obs = self.kept.whole(state).obs
        return jnp.ravel(obs if self.part is None else obs[self.part]).astype(float)

    def metrics(self, state: tuple[Array, ...]) -> dict[str, Array]:
        """The numbers that the library's state has under metrics, such as the parts of the reward."""
        return {str(name): jnp.mean(value) for name, value in self.kept.whole(state).metrics.items()}


@dataclasses.dataclass(frozen=True)
class Gymnax:
    """A task of gymnax (Lange, 2022): its own steps and first states, with time limits told apart from ends."""

    env: Any
    params: Any
    """Its EnvParams."""
    name: str
    max_episode_steps: int
    n_actions: int
    """The number of actions to choose from; 0 where actions are numbers."""
    shape: tuple[int, ...] = ()
    """Of actions that are numbers."""
    low: tuple[float, ...] = ()
    """The bounds of their entries."""
    high: tuple[float, ...] = ()

    optimal_return: ClassVar[float | None] = None
    random_return: ClassVar[float | None] = None

    def __repr__(self) -> str:
        return self.name

    @property
    def action_space(self) -> spaces.Space[Any]:
        """The actions, as the task has them."""
        if self.n_actions:
            return spaces.Discrete(self.n_actions)
        low, high = (np.reshape(np.array(bound, np.float32), self.shape) for bound in (self.low, self.high))
        return spaces.Box(low, high)

    @property
    def observation_low(self) -> Float[np.ndarray, " o"]:
        """No bound: the library's own are not kept by all of its tasks."""
        return -self.observation_high

    @property
    def observation_high(self) -> Float[np.ndarray, " o"]:
        """No bound."""
        return box(np.inf, jax.eval_shape(lambda key: self.observe(self.reset(key)), jax.random.key(0)).size)

    def reset(self, key: Key[Array, ""]) -> tuple[Array, PyTree[Array]]:
        """The first observation and state."""
        found: tuple[Array, PyTree[Array]] = self.env.reset_env(key, self.params)
        return found

    def noise(self, key: Key[Array, ""]) -> Key[Array, ""]:
        """The step's key."""
        return key

    def step(
        self, state: tuple[Array, PyTree[Array]], action: Any, noise: Key[Array, ""]
    ) -> tuple[tuple[Array, PyTree[Array]], Float[Array, ""], Bool[Array, ""]]:
        """One step; it has ended where the same step without a time limit has."""
        observation, after, reward, _, _ = self.env.step_env(noise, state[1], action, self.params)
        endless = self.params.replace(max_steps_in_episode=ENDLESS)
        *_, ended, _ = self.env.step_env(noise, state[1], action, endless)
        following = jax.tree.map(lambda new, old: jnp.asarray(new, old.dtype), (observation, after), state)
        return following, jnp.asarray(reward, float), jnp.asarray(ended, bool)

    def observe(self, state: tuple[Array, PyTree[Array]]) -> Float[Array, " o"]:
        """The observation, flat."""
        return jnp.ravel(state[0]).astype(float)


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
    with needed(f"environment {name!r}", library if library != "playground" else "mujoco_playground"):
        return MAKERS[library](task, dict(options))


def _known(library: str, task: str, names: Sequence[str]) -> None:
    told = did_you_mean(task, names) or f"; it has {', '.join(sorted(names))}"
    require(task in names, f"environment is '{library}:{task}', and {library} has no task {task!r}{told}")


def _made(name: str, maker: Callable[[], Any]) -> Any:
    """What a library makes, whose errors are told with the name."""
    try:
        return maker()
    except (TypeError, ValueError, KeyError, AttributeError, FileNotFoundError) as error:
        raise UsageError(f"environment {name!r} can't be made: {type(error).__name__}: {error}") from error


def of_brax(env: Any, name: str, max_episode_steps: int, observation: str | None = None) -> BraxLike:
    """The record of an environment that has Brax's protocol, of this library or your own.

    Args:
        env: the bare environment, with `reset`, `step` and `action_size`; actions lie between −1 and 1.
        name: its name in messages.
        max_episode_steps: the time limit.
        observation: the key of what the policy sees, where observations are a dictionary.

    Raises:
        UsageError: a dictionary of observations, and none of its keys is named.
    """
    kept = _kept(env)
    obs = jax.tree.unflatten(kept.structure, kept.shapes).obs
    if isinstance(obs, Mapping):
        require(
            observation in obs,
            f"environment {name!r} observes a dictionary of {', '.join(obs)}, and observation is {observation!r}; name "
            "the one that the policy is to see, as env_kwargs={'observation': 'state'}",
        )
    else:
        require(observation is None, f"observation is {observation!r}, and {name!r} observes an array; leave it out")
    return BraxLike(Held(env), name, max_episode_steps, kept, observation)


def _gymnax(task: str, options: dict[str, Any]) -> Gymnax:
    import gymnax

    name = f"gymnax:{task}"
    _known("gymnax", task, gymnax.registered_envs)
    env, params = _gymnax_env(task)
    limit = options.pop("max_episode_steps", int(params.max_steps_in_episode))
    params = _made(name, lambda: params.replace(**options))
    space, own = env.action_space(params), params.replace(max_steps_in_episode=limit)
    kind = type(space).__name__
    require(kind in ("Box", "Discrete"), f"environment {name!r} has actions {kind}; Galton acts in Box and Discrete")
    if kind == "Discrete":
        return Gymnax(env, own, name, limit, int(space.n))
    bounds = (np.broadcast_to(np.asarray(bound, float), space.shape).ravel() for bound in (space.low, space.high))
    return Gymnax(env, own, name, limit, 0, tuple(space.shape), *(tuple(map(float, bound)) for bound in bounds))


@functools.cache
def _gymnax_env(task: str) -> tuple[Any, Any]:
    import gymnax

    found: tuple[Any, Any] = gymnax.make(task)
    return found


def _brax(task: str, options: dict[str, Any]) -> BraxLike:
    from brax import envs

    _known("brax", task, [*envs._envs])
    return _brax_record(task, tuple(sorted(options.items())))


@functools.cache
def _brax_record(task: str, options: tuple[tuple[str, Any], ...]) -> BraxLike:
    from brax import envs

    own, name = dict(options), f"brax:{task}"
    limit, part = own.pop("max_episode_steps", 1000), own.pop("observation", None)
    return of_brax(_made(name, lambda: envs.get_environment(task, **own)), name, limit, part)


def _playground(task: str, options: dict[str, Any]) -> BraxLike:
    from mujoco_playground import registry

    _known("playground", task, registry.ALL_ENVS)
    return _playground_record(task, tuple(sorted(options.items())))


@functools.cache
def _playground_record(task: str, options: tuple[tuple[str, Any], ...]) -> BraxLike:
    from mujoco_playground import registry

    own, name = dict(options), f"playground:{task}"
    part = own.pop("observation", None)
    limit = own.pop("max_episode_steps", registry.get_default_config(task).episode_length)
    overrides = {"impl": "jax"} | own
    env = _made(name, lambda: registry.load(task, config_overrides=overrides))
    return of_brax(env, name, limit, part)


MAKERS: dict[str, Callable[[str, dict[str, Any]], Any]] = {
    "gymnax": _gymnax,
    "brax": _brax,
    "playground": _playground,
}
"""The libraries whose tasks go by library:task."""
