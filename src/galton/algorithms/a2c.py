"""Advantage actor-critic with the semantics of Stable-Baselines3's A2C and Adam (App. C.2): one step per rollout."""

import jax
import jax.numpy as jnp
from jaxtyping import Array, Key

from galton.algorithms import actor_critic, credit, entropy
from galton.algorithms.actor_critic import Objective, flatten
from galton.algorithms.base import Agent, Algorithm, Scalars
from galton.types import Config, Hypers, Learner, Params, Transition


def update(
    agent: Agent, learner: Learner, batch: Transition, hypers: Hypers, key: Key[Array, ""]
) -> tuple[Learner, Scalars]:
    """One gradient step on a rollout `[T, N]`. Nothing in it is random, unless the policy moves its outputs."""
    observation, next_observation, action = map(flatten, (batch.observation, batch.next_observation, batch.action))

    def objective(params: Params) -> tuple[Array, Objective]:
        next_values = jax.lax.stop_gradient(actor_critic.value(agent, params, next_observation, hypers))
        outputs, estimates = actor_critic.outputs(params, observation)
        fixed_values = jax.lax.stop_gradient(agent.critic.value(estimates, hypers))
        advantage = actor_critic.advantages(fixed_values, next_values, batch, hypers)
        returns = advantage + fixed_values
        weight = credit.weights(agent.config, advantage, hypers)
        seen = actor_critic.as_update_sees(agent, outputs, key, hypers)
        distribution = agent.policy.distribution(seen, params, hypers)
        loss = credit.by_sign(
            weight,
            credit.loss(agent, distribution, action, hypers),
            credit.of_negatives(agent.config, distribution, action, hypers),
        )
        numbers = entropy.with_bonus(agent, learner, distribution, weight, hypers)
        critic_loss = agent.critic.loss(estimates, returns, hypers)
        parts = actor_critic.objective(distribution, loss, weight, critic_loss, numbers)
        return parts.total, parts

    gradient, parts = jax.grad(objective, has_aux=True)(learner.params)
    told = entropy.scalars(agent, learner, parts.entropy, hypers)
    learner, grad_norm = actor_critic.step(agent, learner, gradient, hypers)
    learner = entropy.follow(agent, learner, parts.entropy, hypers, jnp.isfinite(grad_norm))
    return learner, actor_critic.scalars(parts, grad_norm) | told


def check(config: Config) -> None:
    """Raise UsageError where an entropy is to be held and there is one step per update."""
    entropy.check(config, config.rollout_size, "n_steps or n_envs")


ALGORITHM = Algorithm("a2c", "A2C", update, actor_critic.SCALARS, choices=credit.CHOICES, check=check)
