"""A diagnosis of the policy in training is computed on one rollout at each log point."""

import functools

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from galton.algorithms import Agent, Scalars, actor_critic
from galton.algorithms.actor_critic import by_sign, flatten
from galton.losses import surrogate
from galton.theory import gradient_bound
from galton.types import Learner, Params, Transition

_MOST = 256
"""Rows of a rollout that the gradient and its bound are computed on: they take each sample in turn."""


def diagnose(agent: Agent, learner: Learner, batch: Transition) -> Scalars:
    """The log's diagnosis of the learner's parameters, on the rollout `[T, N]` that they were just trained on.

    - actor_grad_norm: of the policy loss mean(w · loss), where w is the advantage or the positive weight made of it, in
      the parameters θ of Propositions 1 and 2, all of the actor's but its last bias; and grad_bound, the mean of the
      propositions' bound, which the norm never exceeds. Both on 129 to 256 rows of the rollout, evenly spread, or on
      all if there are fewer.
    - sigma: mean standard deviation of the policy's actions, of the numbers among them; not there where none is one.
    - edge_share: share of the action entries in the first and last bins; for the Gaussian, of those that were clipped;
      for a density that stays inside the box, of those in its first and last hundredth.
    - explained_variance: of the returns by the critic; 1 is perfect, 0 or less is useless.
    - hl_gauss_bias: |mean w| · mean ‖loss.bias‖, how far the loss pulls away from the policy gradient; for HL-Gauss the
      norm is that of Kᵀπ − π, for a loss without a bias it is 0. A w whose target is one bin counts as 0.
    """
    params = learner.params
    observation, next_observation, action = map(flatten, (batch.observation, batch.next_observation, batch.action))
    values = actor_critic.value(agent, params, observation)
    next_values = actor_critic.value(agent, params, next_observation)
    advantage = actor_critic.advantages(agent, values, next_values, batch)
    returns = advantage + values
    outputs = actor_critic.actor_outputs(agent, params, observation)
    distribution = agent.policy.distribution(outputs, params)
    seen = actor_critic.as_update_sees(agent, outputs, params, action)
    weight = advantage if agent.credit.is_signed else agent.credit.weights(advantage)
    bias = jnp.zeros(())
    if agent.loss.is_biased:
        pull = jnp.linalg.norm(agent.loss.bias(seen), axis=-1)
        of_wide = weight if agent.loss.of_negatives(seen, action) is None else jnp.maximum(weight, 0.0)
        bias = jnp.abs(of_wide.mean()) * pull.mean()
    std = distribution.std()
    std = std[..., np.array(agent.box.numbers, int)] if agent.box.n_values else std
    some = slice(None, None, -(-len(advantage) // _MOST))
    return _propositions(agent, params, observation[some], action[some], weight[some]) | {
        **({"sigma": std.mean()} if agent.box.numbers else {}),
        "edge_share": distribution.at_edge(action).mean(),
        "explained_variance": 1 - jnp.var(returns - values) / jnp.var(returns),
        "hl_gauss_bias": bias,
    }


def _propositions(
    agent: Agent,
    params: Params,
    observation: Float[Array, "B o"],
    action: Float[Array, "B d"],
    weight: Float[Array, " B"],
) -> Scalars:
    """The norm of the policy loss's gradient, and the mean of the samples' bounds where the network knows its l."""
    network, actor = agent.network, params["actor"]
    observation, mask = actor_critic.apart(agent, observation)

    def loss_of(outputs: Array, action: Array, weight: Array, mask: Array | None) -> Array:
        outputs = actor_critic.policy_outputs(agent, outputs, mask)
        distribution = actor_critic.as_update_sees(agent, outputs, params, action)
        return by_sign(weight, agent.loss(distribution, action), agent.loss.of_negatives(distribution, action))

    def policy_loss(theta: list[Params]) -> Array:
        return surrogate(weight, loss_of(network(theta, observation), action, weight, mask))

    gradient = jax.grad(policy_loss)(actor)
    gradient[-1]["bias"] = jnp.zeros(())
    norm = jnp.sqrt(sum(jnp.vdot(leaf, leaf) for leaf in jax.tree.leaves(gradient)))
    lipschitz = jax.lax.map(functools.partial(network.lipschitz, actor), observation)  # in turn: it needs much memory
    if lipschitz is None:
        return {"actor_grad_norm": norm}
    slopes = jax.vmap(jax.grad(loss_of))(network(actor, observation), action, weight, mask)
    bound = jax.vmap(gradient_bound)(weight, lipschitz, network.features(actor, observation), slopes)
    return {"actor_grad_norm": norm, "grad_bound": bound.mean()}
