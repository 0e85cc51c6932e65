"""An algorithm of your own: on-policy advantage-weighted regression. A class, and a line in ALGORITHMS.

Each sample is weighted by exp(A / β), never by a negative number (Peng et al., 2019): the loss is regression or
classification to the letter, and every loss of Galton's fits.
"""

import jax
import jax.numpy as jnp

import galton
from galton.algorithms import actor_critic
from galton.algorithms.actor_critic import flatten
from galton.algorithms.credit import standardise
from galton.types import Count, Positive


class AWR(galton.Algorithm):
    """Gradient steps on a rollout [T, N], with advantages of the critic that began it; nothing is random."""

    name = "awr"
    label = "AWR"
    scalars = (*actor_critic.SCALARS, "largest_weight")

    awr_beta: Positive = 1.0
    """The standardised advantage that makes a weight e times as large, β."""
    n_repeats: Count = 10
    """Gradient steps on each rollout."""

    def update(self, agent, learner, batch, key):
        del key
        observation, following, action = map(flatten, (batch.observation, batch.next_observation, batch.action))
        values = actor_critic.value(agent, learner.params, observation)
        next_values = actor_critic.value(agent, learner.params, following)
        advantage = actor_critic.advantages(agent, values, next_values, batch)
        returns = advantage + values
        weight = jnp.minimum(jnp.exp(standardise(advantage) / self.awr_beta), 20.0)

        def step(learner, _):
            def objective(params):
                outputs, estimates = actor_critic.outputs(agent, params, observation)
                distribution = agent.policy.distribution(outputs, params)
                loss = agent.loss(distribution, action)
                critic_loss = agent.critic.loss(estimates, returns)
                parts = actor_critic.objective(agent, learner, distribution, loss, weight, critic_loss)
                return parts.total, parts

            gradient, parts = jax.grad(objective, has_aux=True)(learner.params)
            learner, told = actor_critic.step(agent, learner, gradient, parts)
            return learner, told | {"largest_weight": weight.max()}

        learner, told = jax.lax.scan(step, learner, length=self.n_repeats)
        return learner, jax.tree.map(jnp.mean, told)


galton.ALGORITHMS["awr"] = AWR

if __name__ == "__main__":
    galton.use_all_cores()
    for loss in ("gaussian", "hl-gauss"):
        config = AWR.config(loss=loss, n_steps=64, net_arch=(), n_bins=41)
        result = galton.train("bandit", config, AWR.hypers(learning_rate=0.01, eta=0.75), range(20), 20_000, n_logs=20)
        print(f"{loss:9} final training return {result.final('training_return').mean():.2f} of 25")
