"""An algorithm of your own: on-policy advantage-weighted regression. A class, and a line in ALGORITHMS.

Each sample is weighted by exp(A / β σ), never by a negative number (Peng et al., 2019): the loss is regression or
classification to the letter, and every loss of Galton's fits. σ is a state of its own: the running size of advantages.
"""

import jax
import jax.numpy as jnp

import galton
from galton.algorithms import actor_critic
from galton.algorithms.actor_critic import flatten
from galton.types import Count, Positive, Share


class AWR(galton.Algorithm):
    """Gradient steps on a rollout [T, N], with advantages of the critic that began it; nothing is random."""

    name = "awr"
    label = "AWR"
    scalars = (*actor_critic.SCALARS, "largest_weight", "advantage_size")

    awr_beta: Positive = 1.0
    """The advantage that makes a weight e times as large, in running sizes of advantages, β."""
    memory: Share = 0.9
    """The share of the running size that stays after each rollout."""
    n_repeats: Count = 10
    """Gradient steps on each rollout."""

    def init(self, agent, params):
        return {"size": jnp.ones(())}

    def update(self, agent, learner, batch, key):
        observation, following, action = map(flatten, (batch.observation, batch.next_observation, batch.action))
        values = actor_critic.value(agent, learner.params, observation)
        next_values = actor_critic.value(agent, learner.params, following)
        advantage = actor_critic.advantages(agent, values, next_values, batch)
        returns = advantage + values
        size = self.memory * learner.memory["algorithm"]["size"] + (1 - self.memory) * advantage.std()
        weight = jnp.minimum(jnp.exp((advantage - advantage.mean()) / (self.awr_beta * size)), 20.0)

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
            return learner, told | {"largest_weight": weight.max(), "advantage_size": size}

        learner, told = jax.lax.scan(step, learner, length=self.n_repeats)
        learner = learner.remembering(algorithm={"size": size})
        return learner, jax.tree.map(jnp.mean, told)


galton.ALGORITHMS["awr"] = AWR

if __name__ == "__main__":
    galton.use_all_cores()
    for loss in ("gaussian", "hl-gauss"):
        shared = {"n_steps": 64, "net_arch": (), "n_bins": 41, "learning_rate": 0.01, "eta": 0.75}
        agent = galton.make_agent(algorithm="awr", loss=loss, awr_beta=0.5, **shared)
        result = galton.train("bandit", agent, range(20), 20_000, n_logs=20)
        print(f"{loss:9} final training return {result.final('training_return').mean():.2f} of 25")
