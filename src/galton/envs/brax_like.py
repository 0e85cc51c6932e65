"""Environments of Brax's protocol, which Playground's have too, as records: what they carry, and where arrays go."""

import copy
import dataclasses
from collections.abc import Hashable, Mapping, Sequence
from typing import Any, ClassVar

import jax
import jax.numpy as jnp
import numpy as np
from jax.interpreters.partial_eval import dce_jaxpr
from jaxtyping import Array, Bool, Float, Key, PyTree

from galton.envs.base import box
from galton.envs.other_record import OtherRecord
from galton.errors import require, require_integer


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
    """The shapes of all leaves."""
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
    action = jax.eval_shape(lambda: jnp.zeros(env.action_size))

    def step(action: Array, *leaves: Array) -> Any:
        return env.step(jax.tree.unflatten(structure, leaves), action)

    traced, told = jax.make_jaxpr(step, return_shape=True)(action, *shapes)
    program, after = traced.jaxpr, str(jax.tree.structure(told))
    what = f"env is {type(env).__name__}, whose state is {structure} after reset and {after} after step"
    require(after == str(structure), f"{what}; training needs both alike")
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
    return jax.tree.leaves(getattr(numbers, name))


@dataclasses.dataclass(frozen=True, repr=False)
class BraxLike(OtherRecord):
    """An environment whose `reset(key)` and `step(state, action)` return a state with obs, reward and done.

    That is the protocol of Brax and Playground. The environment is the bare one, without wrappers: time limits and new
    episodes are Galton's own, so that the last observation of an episode is never lost. A state may hold a key of what
    is random: with resets="first" each episode of a copy then has the same randomness again, with "pool" another.
    """

    held: Held
    name: str
    max_episode_steps: int
    kept: Kept
    part: str | None = None
    """The key of what the policy sees, where observations are a dictionary."""

    resets_slowly: ClassVar[bool] = True
    """True: a physics engine's first state may cost as much as many steps."""

    @property
    def action_low(self) -> Float[np.ndarray, " d"]:
        """−1, as both libraries have it."""
        return -self.action_high

    @property
    def action_high(self) -> Float[np.ndarray, " d"]:
        """1, as both libraries have it."""
        return box(1, self.held.env.action_size)

    def reset(self, key: Key[Array, ""]) -> tuple[Array, ...]:
        """A first state, of what is carried alone."""
        return self.kept.taken(self.held.env.reset(jax.random.key_data(key)))

    def noise(self, key: Key[Array, ""]) -> tuple[()]:
        """Nothing: a state holds the key of what is random."""
        return ()

    def step(
        self, state: tuple[Array, ...], action: Float[Array, " d"], noise: tuple[()]
    ) -> tuple[tuple[Array, ...], Float[Array, ""], Bool[Array, ""]]:
        """One step of the bare environment."""
        after = self.held.env.step(self.kept.whole(state), action)
        return self.kept.taken(after), jnp.asarray(after.reward, float), after.done > 0.5

    def observe(self, state: tuple[Array, ...]) -> Float[Array, " o"]:
        """The observation that the policy sees, flat."""
        obs = self.kept.whole(state).obs
        return jnp.ravel(obs if self.part is None else obs[self.part]).astype(float)

    def metrics(self, state: tuple[Array, ...]) -> dict[str, Array]:
        """The numbers that the library's state has under metrics, such as the parts of the reward."""
        return {str(name): jnp.mean(value) for name, value in self.kept.whole(state).metrics.items()}


def of_brax(env: Any, name: str, max_episode_steps: int, observation: str | None = None) -> BraxLike:
    """The record of an environment that has Brax's protocol, of this library or your own.

    Args:
        env: the bare environment, with `reset`, `step` and `action_size`; actions lie between −1 and 1.
        name: its name in messages.
        max_episode_steps: the time limit.
        observation: the key of what the policy sees, where observations are a dictionary.

    Raises:
        UsageError: a time limit that is none, or a dictionary of observations, and none of its keys is named.
    """
    require_integer("max_episode_steps", max_episode_steps, 1)
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
