"""Advantage actor-critic with the semantics of Stable-Baselines3's A2C and Adam (App. C.2): one step per rollout."""

import jax
from jaxtyping import Array, Key

from galton.algorithms import actor_critic
from galton.algorithms.actor_critic import Objective, flatten
from galton.algorithms.base import Agent, Algorithm, Scalars
from galton.types import Hypers, Learner, Params, Transition


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
        if agent.config.normalize_advantage:
            advantage = actor_critic.standardise(advantage)
        seen = actor_critic.as_update_sees(agent, outputs, key, hypers)
        distribution = agent.policy.distribution(seen, params, hypers)
        loss = agent.loss.function(distribution, action, hypers)
        critic_loss = agent.critic.loss(estimates, returns, hypers)
        parts = actor_critic.objective(distribution, loss, advantage, critic_loss, hypers)
        return parts.total, parts

    gradient, parts = jax.grad(objective, has_aux=True)(learner.params)
    learner, grad_norm = actor_critic.step(agent, learner, gradient, hypers)
    return learner, actor_critic.scalars(parts, grad_norm)


ALGORITHM = Algorithm("a2c", "A2C", update, actor_critic.SCALARS)
