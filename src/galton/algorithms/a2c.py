"""Advantage actor-critic with the semantics of Stable-Baselines3's A2C and Adam (App. C.2): one step per rollout."""

from typing import ClassVar

import jax
from jaxtyping import Array, Key

from galton.algorithms import actor_critic
from galton.algorithms.actor_critic import Objective, flatten
from galton.algorithms.base import CARRIED_OUT, Agent, Algorithm, Scalars
from galton.types import Learner, Params, Transition


class A2C(Algorithm):
    """One gradient step on a rollout `[T, N]`. Nothing in it is random, unless the policy moves its outputs."""

    name: ClassVar[str] = "a2c"
    label: ClassVar[str] = "A2C"
    scalars: ClassVar[tuple[str, ...]] = actor_critic.SCALARS
    choices: ClassVar[tuple[str, ...]] = CARRIED_OUT

    def update(self, agent: Agent, learner: Learner, batch: Transition, key: Key[Array, ""]) -> tuple[Learner, Scalars]:
        """The learner after the step, and what it tells."""
        observation, next_observation, action = map(flatten, (batch.observation, batch.next_observation, batch.action))

        def objective(params: Params) -> tuple[Array, Objective]:
            next_values = jax.lax.stop_gradient(actor_critic.value(agent, params, next_observation))
            outputs, estimates = actor_critic.outputs(agent, params, observation)
            fixed_values = jax.lax.stop_gradient(agent.critic.value(estimates))
            advantage = actor_critic.advantages(agent, fixed_values, next_values, batch)
            distribution = actor_critic.as_update_sees(agent, outputs, params, action, key)
            weight = agent.credit.weights(advantage)
            loss, of_negatives = agent.loss(distribution, action), agent.loss.of_negatives(distribution, action)
            loss = actor_critic.by_sign(weight, loss, of_negatives)
            critic_loss = agent.critic.loss(estimates, advantage + fixed_values)
            parts = actor_critic.objective(agent, learner, distribution, loss, weight, critic_loss)
            return parts.total, parts

        gradient, parts = jax.grad(objective, has_aux=True)(learner.params)
        return actor_critic.step(agent, learner, gradient, parts)

    def check(self, agent: Agent) -> None:
        """Raise UsageError where an entropy is to be held and there is one step per update."""
        agent.entropy.check(agent.rollout.size, "n_steps or n_envs")
