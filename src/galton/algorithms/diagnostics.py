"""What the log says of a policy in training, computed on one rollout at each log point."""

import functools
from typing import NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from galton.algorithms import a2c
from galton.losses import find_loss, surrogate
from galton.networks import features, mlp
from galton.policies import Policy
from galton.theory import gradient_bound, output_lipschitz
from galton.types import Config, Hypers, Learner, Params, Transition


class Diagnosis(NamedTuple):
    """Of the learner's parameters as they are, on a rollout that it has just been trained on; scalars."""

    actor_grad_norm: Float[Array, ""]
    """Of the policy loss in the parameters θ of Propositions 1 and 2: all of the actor's but its last bias."""
    grad_bound: Float[Array, ""]
    """Mean over the batch of the propositions' bound, which the norm never exceeds."""
    sigma: Float[Array, ""]
    """Mean standard deviation of the policy's actions."""
    edge_share: Float[Array, ""]
    """Share of the action entries in the first and last bins; for the Gaussian, of those that were clipped."""
    explained_variance: Float[Array, ""]
    """Of the returns by the critic: 1 is perfect, 0 or less is useless."""
    hl_gauss_bias: Float[Array, ""]
    """|mean advantage| · mean ‖Kᵀπ − π‖: HL-Gauss's pull away from the policy gradient; 0 for the other losses."""


def diagnose(config: Config, policy: Policy, learner: Learner, batch: Transition, hypers: Hypers) -> Diagnosis:
    """Look at a rollout `[T, N]`; about the cost of one update."""
    params = learner.params
    observation, next_observation, action = map(a2c.flatten, (batch.observation, batch.next_observation, batch.action))
    values = a2c.value(params, observation)
    advantage = a2c.advantages(values, a2c.value(params, next_observation), batch, hypers)
    returns = advantage + values
    loss = find_loss(config.loss)

    def policy_loss(theta: list[Params]) -> Array:
        distribution = policy.distribution(mlp(theta, observation), params)
        return surrogate(advantage, loss.function(distribution, action, hypers.eta))

    def sample_loss(output: Array, action: Array) -> Array:
        return loss.function(policy.distribution(output, params), action, hypers.eta)

    gradient = jax.grad(policy_loss)(params["actor"])
    gradient[-1]["bias"] = jnp.zeros(())
    outputs = mlp(params["actor"], observation)
    bound = jax.vmap(gradient_bound)(
        advantage,
        jax.lax.map(functools.partial(output_lipschitz, params["actor"]), observation),  # in turn: it needs much memory
        features(params["actor"], observation),
        jax.vmap(jax.grad(sample_loss))(outputs, action),
    )
    distribution = policy.distribution(outputs, params)
    bias = jnp.zeros(())
    if loss.bias:
        pull = jnp.linalg.norm(loss.bias(distribution, hypers.eta), axis=-1)
        bias = jnp.abs(advantage.mean()) * pull.mean()
    return Diagnosis(
        actor_grad_norm=jnp.sqrt(sum(jnp.vdot(leaf, leaf) for leaf in jax.tree.leaves(gradient))),
        grad_bound=bound.mean(),
        sigma=distribution.std().mean(),
        edge_share=distribution.at_edge(action).mean(),
        explained_variance=1 - jnp.var(returns - values) / jnp.var(returns),
        hl_gauss_bias=bias,
    )
