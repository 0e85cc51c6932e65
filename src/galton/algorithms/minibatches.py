"""PPO, TRPO and V-MPO go through a rollout in minibatches, whose targets may be fixed before the first."""

import math
from typing import Any

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, Int, Key

from galton.algorithms.base import Agent
from galton.errors import require
from galton.losses import cross_entropy


def require_whole(agent: Agent, batch_size: int) -> None:
    """Raise UsageError unless minibatches of this size divide a rollout."""
    n_steps, n_envs, size = agent.rollout.n_steps, agent.rollout.n_envs, agent.rollout.size
    require(
        size % batch_size == 0,
        f"batch_size is {batch_size}, but a rollout has n_steps · n_envs = {n_steps} · {n_envs} = {size} steps; choose "
        "numbers so that it has a whole number of minibatches",
    )


def orders(key: Key[Array, ""], n_passes: int, size: int) -> Int[Array, "{n_passes} {size}"]:
    """Each pass over a rollout of so many rows has an order of its own."""
    return jax.vmap(lambda key: permutation(key, size))(jax.random.split(key, n_passes))


def permutation(key: Key[Array, ""], size: int) -> Int[Array, " {size}"]:
    """The permutation that jax.random.permutation(key, size) draws, in a quarter of its time on a CPU.

    That sorts by random numbers of 32 bits, as often as ties of a single sort would matter. XLA is slow to sort one
    array by another, and quick to sort whole numbers: here they hold the random number, and below it the place.
    """
    order = jnp.arange(size)
    for _ in range(math.ceil(3 * math.log(size) / math.log(2**32 - 1))):
        key, own = jax.random.split(key)
        bits = jax.random.bits(own, (size,), jnp.uint32)
        with jax.enable_x64(True):
            both = (bits.astype(jnp.uint64) << jnp.uint64(32)) | jnp.arange(size, dtype=jnp.uint64)
            places = jax.lax.sort(both, is_stable=False).astype(jnp.uint32)
        order = order[places]
    return order


def loss(
    agent: Agent, distribution: Any, action: Float[Array, "B d"], target: Float[Array, "B d k"] | None
) -> Float[Array, " B"]:
    """The agent's loss, with a target that is there already or the loss's own."""
    return agent.loss(distribution, action) if target is None else cross_entropy(distribution, target)
