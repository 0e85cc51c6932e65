"""Environments in pure JAX, stepped from Python: for what is played outside the compiled training loop."""

import functools
from collections.abc import Sequence
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int, Integer, Key, PyTree

from galton.envs.base import Environment
from galton.envs.host.base import Steps
from galton.envs.host.moves import Moves
from galton.errors import UsageError


class RecordEnvironments:
    """M copies of a record of ours, as HostEnvironments: they begin new episodes where one ended."""

    moves: Sequence[Moves] = ()
    layers: Sequence[list[Any]] = ()

    def __init__(self, env: Environment) -> None:
        self._env = env

    def reset(self, seeds: Integer[np.ndarray, " M"]) -> Float[np.ndarray, "M o"]:
        """Begin episodes; a copy's seed decides all of its future."""
        self._keys = jax.vmap(jax.random.key)(jnp.asarray(seeds, jnp.uint32))
        self._state, observation = _reset(self._env, self._keys)
        self._length, self._n_steps = jnp.zeros(len(seeds), jnp.int32), 0
        return np.asarray(observation)

    def step(self, action: Float[np.ndarray, "M d"]) -> Steps:
        """Act, clipped into the box."""
        self._n_steps += 1
        keys = (self._keys, jnp.int32(self._n_steps))
        self._state, self._length, steps = _step(self._env, self._state, self._length, jnp.asarray(action), *keys)
        return Steps(*map(np.asarray, steps))

    def get_state(self) -> None:
        """None, since training has states of its own."""

    def set_state(self, state: dict[str, np.ndarray]) -> None:
        """Always a UsageError, since `get_state` tells none."""
        del state
        raise UsageError("a record stepped from Python can't be put into a state")

    def close(self) -> None:
        """Do nothing, since environments in JAX hold nothing open."""


@functools.partial(jax.jit, static_argnums=0)
def _reset(env: Environment, keys: Key[Array, " M"]) -> tuple[PyTree[Array], Float[Array, "M o"]]:
    states = jax.vmap(env.reset)(keys)
    return states, jax.vmap(env.observe)(states)


@functools.partial(jax.jit, static_argnums=0)
def _step(
    env: Environment,
    states: PyTree[Array],
    lengths: Int[Array, " M"],
    actions: Float[Array, "M d"],
    keys: Key[Array, " M"],
    n_steps: Int[Array, ""],
) -> tuple[PyTree[Array], Int[Array, " M"], tuple[Array, ...]]:
    def one(
        state: PyTree[Array], length: Array, action: Array, key: Array
    ) -> tuple[PyTree[Array], Array, tuple[Array, ...]]:
        noise_key, reset_key = jax.random.split(jax.random.fold_in(key, n_steps))
        clipped = jnp.clip(action, env.action_low, env.action_high)
        state, reward, terminated = env.step(state, clipped, env.noise(noise_key))
        final, truncated = env.observe(state), ~terminated & (length + 1 >= env.max_episode_steps)
        ended = terminated | truncated
        state = jax.tree.map(lambda fresh, old: jnp.where(ended, fresh, old), env.reset(reset_key), state)
        return state, jnp.where(ended, 0, length + 1), (env.observe(state), final, reward, terminated, truncated)

    return jax.vmap(one)(states, lengths, actions, keys)
