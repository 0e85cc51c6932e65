"""Environments in pure JAX as tasks, and their steps from Python: for what is played outside the training loop."""

import dataclasses
import functools
from collections.abc import Hashable, Sequence
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from gymnasium.spaces import Box
from jaxtyping import Array, Bool, Float, Int, Integer, Key, PyTree

from galton.envs.host import masks
from galton.envs.host.actions import Actions
from galton.envs.host.base import Steps
from galton.envs.host.moves import Moves
from galton.envs.host.observations import Observations
from galton.errors import UsageError, require, require_integer


@jax.tree_util.register_pytree_node_class
class JaxTask:
    """An environment in pure JAX, whose steps are part of the compiled training loop.

    It is a pytree. The JAX arrays in the fields of a dataclass, or in a record that is a pytree itself, are its leaves,
    and so arguments of the programs. All else is its structure, for which programs are compiled.

    Args:
        record: the environment.
        action_scale: the factor by which a policy's action is larger than the environment's.

    Raises:
        UsageError: a record with something in it that can't be hashed, or spaces that Galton can't use.
    """

    record: Any
    """The environment as it was given, in pure JAX."""
    given: int | None = None
    """None: copies of it are drawn, not given."""
    n_threads = 1

    def __init__(self, record: Any, action_scale: float = 1.0) -> None:
        self._arrays, self._rest = _taken_apart(record)
        self.record, self.action_scale = record, action_scale
        _ = self.actions, self.observations
        try:
            hash(self._rest)
        except TypeError as error:
            raise UsageError(
                f"env is {self.name}, a record whose structure can't be hashed, as a key of compiled programs must be "
                f"({error}); give it tuples for lists, and arrays as jax.numpy makes them, in its own fields"
            ) from None

    def __repr__(self) -> str:
        scaled = "" if self.action_scale == 1 else f" with actions times {self.action_scale:g}"
        return f"{self.record!r}{scaled}"

    @property
    def name(self) -> str:
        """The name that messages and files have for it."""
        return str(getattr(self.record, "name", None) or type(self.record).__name__)

    @property
    def actions(self) -> Actions:
        """The actions that policies take, as the environment has them and as a vector."""
        own = getattr(self.record, "action_space", None)
        if own is None:
            own = self._box("action")
        return Actions(self.name, own, self.action_scale, self._n_mask)

    @property
    def observations(self) -> Observations:
        """The observations that a copy shows."""
        return Observations(self.name, self._box("observation"), self._n_mask)

    def _box(self, kind: str) -> Box:
        """The box between bounds that may be arrays of any kind, lists or numbers."""
        with jax.ensure_compile_time_eval():  # jax.numpy makes them inside of a program, too
            low, high = (np.asarray(getattr(self.record, f"{kind}_{end}"), np.float32) for end in ("low", "high"))
        return Box(np.atleast_1d(low), np.atleast_1d(high))

    @property
    def _n_mask(self) -> int:
        mask_of: Any = getattr(self.record, "action_mask", None)
        if mask_of is None:
            return 0
        told = jax.eval_shape(lambda key: mask_of(self.record.reset(key)), jax.random.key(0))
        return int(np.prod(told.shape))

    def observe(self, state: PyTree[Array]) -> Float[Array, " o"]:
        """The record's observation of a state, and behind it the mask of actions where the record has one.

        Integers and flags become floats.
        """
        observation, mask_of = jnp.asarray(self.record.observe(state)), getattr(self.record, "action_mask", None)
        if not jnp.issubdtype(observation.dtype, jnp.floating):
            observation = observation.astype(float)
        return observation if mask_of is None else jnp.append(observation, mask_of(state).astype(observation.dtype))

    @property
    def is_carried(self) -> bool:
        """True if something of a state outlasts its episode."""
        return getattr(self.record, "carried", None) is not None

    def carried(self, ended: PyTree[Array], fresh: PyTree[Array]) -> PyTree[Array]:
        """The first state of the next episode: a fresh one, with what the record carries over into it."""
        return self.record.carried(ended, fresh) if self.is_carried else fresh

    def going_on(self, trained: PyTree[Array], fresh: PyTree[Array]) -> PyTree[Array]:
        """Fresh states `[M, ...]` with what outlasts episodes in training's copies `[N, ...]`, if any are given."""
        if not jax.tree.leaves(trained):
            return fresh
        m = len(jax.tree.leaves(fresh)[0])
        return jax.vmap(self.carried)(jax.tree.map(lambda x: x[jnp.arange(m) % len(x)], trained), fresh)

    def begun_anew(self, ended: Bool[Array, " N"], states: PyTree[Array], fresh: PyTree[Array]) -> PyTree[Array]:
        """The states of N copies; where an episode has ended, the first of the next one, from a fresh state."""
        first = jax.vmap(self.carried)(states, fresh)
        return jax.tree.map(lambda new, old: jax.vmap(jnp.where)(ended, new, old), first, states)

    def metrics(self, state: PyTree[Array]) -> dict[str, Float[Array, ""]]:
        """The numbers that the record tells of a state for the log, by the names of its columns."""
        of_record: Any = getattr(self.record, "metrics", None)
        found = {} if of_record is None else of_record(state)
        return {f"env_{name}": jnp.asarray(value, float) for name, value in found.items()}

    @functools.cached_property
    def metric_names(self) -> tuple[str, ...]:
        """The names of what `metrics` tells."""
        return tuple(jax.eval_shape(lambda key: self.metrics(self.record.reset(key)), jax.random.key(0)))

    def make(self, n_copies: int, n_threads: int = 1) -> "RecordEnvironments":
        """As many copies as they get seeds, to step from Python: each step is a call of a compiled program."""
        return RecordEnvironments(self)

    def step(
        self, state: PyTree[Array], action: Float[Array, " d"], noise: PyTree[Array]
    ) -> tuple[PyTree[Array], Float[Array, ""], Bool[Array, ""]]:
        """One step of the record under a policy's action, as the record's space has it, clipped into its box."""
        return self.record.step(state, self.actions.to_env(action), noise)

    def __eq__(self, other: object) -> bool:
        """Say whether the same programs serve both, on equal arrays."""
        if not isinstance(other, JaxTask) or self._structure != other._structure:
            return False
        return all(map(np.array_equal, self._arrays, other._arrays))

    def __hash__(self) -> int:
        return hash(self._structure)

    @property
    def _structure(self) -> tuple["_Rest", float]:
        return self._rest, self.action_scale

    def tree_flatten(self) -> tuple[tuple[Any, ...], Hashable]:
        """The arrays of the record, and all else."""
        return self._arrays, self._structure

    @classmethod
    def tree_unflatten(cls, structure: tuple["_Rest", float], arrays: tuple[Any, ...]) -> "JaxTask":
        """The task with these in the place of the arrays."""
        task = cls.__new__(cls)
        task._arrays, (task._rest, task.action_scale) = tuple(arrays), structure
        task.record = task._rest.filled(arrays)
        return task


@functools.lru_cache(maxsize=8)
def check(task: JaxTask) -> None:
    """Raise UsageError unless a step gives a state as `reset` does, and a fitting observation, reward and end."""

    def played(task: JaxTask, key: Key[Array, ""]) -> tuple[Any, ...]:
        first, record = task.record.reset(key), task.record
        state, reward, ended = task.step(first, jnp.asarray(task.actions.low), record.noise(key))
        return first, state, jnp.asarray(record.observe(state)), reward, ended

    if task.observations.n_mask:
        masks.n_entries(task.name, np.ones(task.observations.n_mask), task.actions.box)
    a_record = f"env is {task.name}, a record whose"
    require_integer(f"{a_record} max_episode_steps", task.record.max_episode_steps, 1)
    try:
        jax.eval_shape(lambda task: jnp.zeros(task.observations.size + len(task.actions.low)), task)
    except jax.errors.TracerArrayConversionError as error:
        remedy = "bounds are made of its arrays, which no program knows when it is compiled; make them of NumPy's"
        raise UsageError(f"{a_record} {remedy}") from error
    first, state, *given = jax.eval_shape(played, task, jax.random.key(0))
    before, after = (jax.tree_util.tree_leaves_with_path(each) for each in (first, state))
    kinds = [str(jax.tree.structure(each)) for each in (first, state)]
    require(kinds[0] == kinds[1], f"{a_record} state is {kinds[0]} after reset and {kinds[1]} after step; {_ALIKE}")
    for (path, one), (_, then) in zip(before, after, strict=True):
        was, now = (f"{x.dtype} {x.shape}" for x in (one, then))
        place = f"state{jax.tree_util.keystr(path)}"
        require(was == now, f"{a_record} {place} is {was} after reset and {now} after step; {_ALIKE}")
    shapes = ((task.observations.size - task.observations.n_mask,), (), ())
    for name, shape, told in zip(("observation", "reward", "terminated"), shapes, given, strict=True):
        require(told.shape == shape, f"{a_record} {name} has shape {told.shape}; it must have shape {shape}")
    require(told.dtype == bool, f"{a_record} terminated is of {told.dtype}; it must be of bool, as by terminated > 0.5")


@dataclasses.dataclass(frozen=True)
class _Rest:
    """A record without its arrays."""

    kind: type | None
    """The dataclass whose fields these are; None where the structure makes the record."""
    structure: Any
    leaves: tuple[Hashable, ...]
    """The leaves that are not arrays; `...` stands where one was."""

    def filled(self, arrays: Sequence[Any]) -> Any:
        """The record with these arrays."""
        given = iter(arrays)
        whole = jax.tree.unflatten(self.structure, [next(given) if leaf is ... else leaf for leaf in self.leaves])
        if self.kind is None:
            return whole
        record: Any = object.__new__(self.kind)
        for name, value in whole.items():
            object.__setattr__(record, name, value)
        return record


def _taken_apart(record: object) -> tuple[tuple[Array, ...], _Rest]:
    """The JAX arrays of a record, and all else; a record without any stays whole."""
    kind: Any = type(record) if jax.tree_util.all_leaves([record]) and dataclasses.is_dataclass(record) else None
    fields = {field.name: getattr(record, field.name) for field in dataclasses.fields(kind)} if kind else record
    leaves, structure = jax.tree.flatten(fields)
    arrays = tuple(leaf for leaf in leaves if isinstance(leaf, jax.Array))
    if not arrays:
        return (), _Rest(None, _LEAF, (record,))
    own = getattr(record, "__dict__", {}).keys() - {field.name for field in dataclasses.fields(kind)} if kind else ()
    more = sorted(name for name in own if not isinstance(getattr(kind, name, None), functools.cached_property))
    made_of = "a record that is made anew from its fields, since it holds JAX arrays"
    require(not more, f"env is {record!r:.80}, {made_of}; make {', '.join(more)} a property or a field")
    return arrays, _Rest(kind, structure, tuple(... if isinstance(leaf, jax.Array) else leaf for leaf in leaves))


_LEAF = jax.tree.structure(0)
_ALIKE = "training needs both alike"


class RecordEnvironments:
    """M copies of an environment in pure JAX, as HostEnvironments: they begin new episodes where one ended."""

    moves: Sequence[Moves] = ()
    layers: Sequence[list[Any]] = ()

    def __init__(self, task: JaxTask, trained: PyTree[Array] = ()) -> None:
        self._task, self._trained = task, trained

    def reset(self, seeds: Integer[np.ndarray, " M"]) -> Float[np.ndarray, "M o"]:
        """Begin episodes; a copy's seed decides all of its future."""
        self._keys = jax.vmap(jax.random.key)(jnp.asarray(seeds, jnp.uint32))
        self._state, observation = _reset(self._task, self._keys, self._trained)
        self._length, self._n_steps = jnp.zeros(len(seeds), jnp.int32), 0
        return np.asarray(observation)

    def step(self, action: Float[np.ndarray, "M d"]) -> Steps:
        """Act, clipped into the box."""
        self._n_steps += 1
        keys = (self._keys, jnp.int32(self._n_steps))
        self._state, self._length, steps = _step(self._task, self._state, self._length, jnp.asarray(action), *keys)
        return Steps(*map(np.asarray, steps))

    def get_state(self) -> None:
        """None, since training has states of its own."""

    def set_state(self, state: dict[str, np.ndarray]) -> None:
        """Always a UsageError, since `get_state` tells none."""
        raise UsageError("a record stepped from Python can't be put into a state")

    def close(self) -> None:
        """Do nothing, since environments in JAX hold nothing open."""


@jax.jit
def _reset(task: JaxTask, keys: Key[Array, " M"], trained: PyTree[Array]) -> tuple[PyTree[Array], Float[Array, "M o"]]:
    states = task.going_on(trained, jax.vmap(task.record.reset)(keys))
    return states, jax.vmap(task.observe)(states)


@jax.jit
def _step(
    task: JaxTask,
    states: PyTree[Array],
    lengths: Int[Array, " M"],
    actions: Float[Array, "M d"],
    keys: Key[Array, " M"],
    n_steps: Int[Array, ""],
) -> tuple[PyTree[Array], Int[Array, " M"], tuple[Array, ...]]:
    env = task.record
    noise_keys, reset_keys = jax.vmap(lambda key: jax.random.split(jax.random.fold_in(key, n_steps)), out_axes=1)(keys)
    noise = jax.vmap(env.noise)(noise_keys)
    states, reward, terminated = jax.vmap(task.step)(states, actions, noise)
    final, truncated = jax.vmap(task.observe)(states), ~terminated & (lengths + 1 >= env.max_episode_steps)
    ended = terminated | truncated

    def renewed(states: PyTree[Array]) -> PyTree[Array]:
        return task.begun_anew(ended, states, jax.vmap(env.reset)(reset_keys))

    states = jax.lax.cond(ended.any(), renewed, lambda states: states, states)
    return (
        states,
        jnp.where(ended, 0, lengths + 1),
        (jax.vmap(task.observe)(states), final, reward, terminated, truncated),
    )
