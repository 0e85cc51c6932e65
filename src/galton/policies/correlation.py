"""Noise that persists: what a policy draws for its actions, correlated from step to step of an episode.

Independent noise leads nowhere where a task has to be pushed in one direction for a while. Here numbers z follow
z_t = ρ z_{t−1} + √(1 − ρ²) ε_t with independent standard normal ε, an AR(1) process: z_t is standard normal too, and
its correlation with z_{t−k} is ρ^k. A policy that samples with normal noise takes z, and one that inverts a cumulative
distribution takes Φ(z), which is uniform. So the noise of each step by itself is distributed as without correlation.
Given the state it is not, quite: noise that resembles it has led there. Updates take it as if it were.
"""

import functools

import jax
import jax.numpy as jnp
import numpy as np
from jax.scipy.special import ndtr, ndtri
from jaxtyping import Array, Bool, Float, PyTree

from galton.errors import UsageError
from galton.policies.base import Correlatable, Marginal, Policy
from galton.types import Number


def check_correlation(policy: Policy, correlation: Number | Float[np.ndarray, " R"] | None) -> None:
    """Raise UsageError where noise is to be correlated and the policy doesn't say how it is distributed."""
    if correlation is not None and np.any(correlation) and not isinstance(policy, Correlatable):
        raise UsageError(
            f"noise_correlation is {np.max(correlation):g}, but {type(policy).__name__} doesn't say how its noise is "
            "distributed: give the class noise_marginals (galton.policies.Correlatable), or leave it at 0"
        )


def nothing_before(
    policy: Policy, shape: tuple[int, ...], correlation: Number | Float[np.ndarray, " R"] | None
) -> PyTree[Array]:
    """Return the z that `continued` takes before a first step: zeros of this shape, or () where correlation is None.

    It is None where no run of the program has any.
    """
    if correlation is None:
        return ()
    noise = jax.eval_shape(lambda: policy.noise(jax.random.key(0), shape))
    return jax.tree.map(lambda leaf: jnp.zeros(leaf.shape, leaf.dtype), noise)


def continued(
    policy: Policy,
    drawn: PyTree[Array],
    before: PyTree[Array],
    begins: PyTree[Bool[Array, " N"]],
    correlation: Number | None,
) -> tuple[PyTree[Array], PyTree[Array]]:
    """The noise of one step of N episodes, and its z, which the next step goes on from.

    Args:
        policy: which says how its noise is distributed.
        drawn: independent noise of the policy's, each leaf `[N, ...]`.
        before: the z of the step before, shaped like drawn, or what `nothing_before` gave; where that is () the noise
            is what was drawn, and nothing else is looked at.
        begins: whose step is the first of an episode, where noise begins anew.
        correlation: ρ; for a run where it is 0 the noise is what was drawn.
    """
    if isinstance(before, tuple) and not before:
        return drawn, ()
    assert isinstance(policy, Correlatable)
    assert correlation is not None
    step = functools.partial(_step, policy.noise_marginals, correlation)
    return jax.vmap(step)(drawn, before, begins)


def _step(
    marginals: PyTree[str], correlation: Number, drawn: PyTree[Array], before: PyTree[Array], begins: Bool[Array, ""]
) -> tuple[PyTree[Array], PyTree[Array]]:
    rho = jnp.asarray(correlation)
    fresh = jnp.sqrt((1 - rho) * (1 + rho))

    def next_z(marginal: Marginal, x: Float[Array, "..."], z: Float[Array, "..."]) -> Float[Array, "..."]:
        epsilon = ndtri(x + _half_a_step(x)) if marginal == "uniform" else x
        return jnp.where(begins, epsilon, rho * z + fresh * epsilon)

    def noise(marginal: Marginal, x: Float[Array, "..."], z: Float[Array, "..."]) -> Float[Array, "..."]:
        correlated = jnp.minimum(ndtr(z), 1 - _half_a_step(z)) if marginal == "uniform" else z
        return jnp.where(rho > 0, correlated, x)

    after = jax.tree.map(next_z, marginals, drawn, before)
    return jax.tree.map(noise, marginals, drawn, after), after


def _half_a_step(x: Float[Array, "..."]) -> float:
    """Half a step of jax.random.uniform, whose numbers are multiples of ε from 0 on: Φ⁻¹ is taken in between."""
    return float(np.finfo(x.dtype).eps) / 2
