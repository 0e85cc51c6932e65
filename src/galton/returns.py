"""Advantages and returns of one trajectory; callers batch with vmap. Rewards r_t, values v_t, t = 0 … T − 1.

`next_value` is the value of the observation that follows each step *before* any reset, so a time limit bootstraps
from the state where it struck and a termination from nothing.
"""

import jax.numpy as jnp
from jax import lax
from jaxtyping import Array, Bool, Float

Scalar = float | Float[Array, ""]


def gae(
    reward: Float[Array, " T"],
    value: Float[Array, " T"],
    next_value: Float[Array, " T"],
    terminated: Bool[Array, " T"],
    truncated: Bool[Array, " T"],
    gamma: Scalar,
    gae_lambda: Scalar,
) -> Float[Array, " T"]:
    """Generalised advantage estimates: A_t = δ_t + γλ A_{t+1} with δ_t = r_t + γ v(s_{t+1}) − v_t.

    The sum stops where an episode does; λ = 1 gives the n-step advantages of §5.1.
    """
    delta = reward + gamma * jnp.where(terminated, 0.0, next_value) - value
    decay = jnp.where(terminated | truncated, 0.0, gamma * gae_lambda)

    def step(advantage: Array, inputs: tuple[Array, Array]) -> tuple[Array, Array]:
        delta, decay = inputs
        advantage = delta + decay * advantage
        return advantage, advantage

    return lax.scan(step, jnp.zeros_like(delta[0]), (delta, decay), reverse=True, unroll=min(len(reward), 32))[1]
