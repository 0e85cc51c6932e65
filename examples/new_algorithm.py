"""An algorithm of your own, a record and a line in ALGORITHMS: on-policy advantage-weighted regression.

Each sample is weighted by exp(A / β), never by a negative number (Peng et al., 2019): the loss is regression or
classification to the letter, and every loss of Galton's fits.
"""

import jax
import jax.numpy as jnp

import galton
from galton.algorithms import actor_critic
from galton.algorithms.actor_critic import flatten

BETA, N_STEPS, LARGEST = 1.0, 10, 20.0


def update(agent, learner, batch, hypers, key):
    """Ten gradient steps on a rollout [T, N], with advantages of the critic that began it; nothing is random."""
    del key
    observation, following, action = map(flatten, (batch.observation, batch.next_observation, batch.action))
    values = actor_critic.value(agent, learner.params, observation, hypers)
    next_values = actor_critic.value(agent, learner.params, following, hypers)
    advantage = actor_critic.advantages(values, next_values, batch, hypers)
    returns = advantage + values
    weight = jnp.minimum(jnp.exp(actor_critic.standardise(advantage) / BETA), LARGEST)

    def step(learner, _):
        def objective(params):
            outputs, estimates = actor_critic.outputs(params, observation)
            distribution = agent.policy.distribution(outputs, params, hypers)
            loss = agent.loss.function(distribution, action, hypers)
            critic_loss = agent.critic.loss(estimates, returns, hypers)
            parts = actor_critic.objective(distribution, loss, weight, critic_loss, hypers)
            return parts.total, parts

        gradient, parts = jax.grad(objective, has_aux=True)(learner.params)
        learner, grad_norm = actor_critic.step(agent, learner, gradient, hypers)
        return learner, actor_critic.scalars(parts, grad_norm) | {"largest_weight": weight.max()}

    learner, told = jax.lax.scan(step, learner, length=N_STEPS)
    return learner, jax.tree.map(jnp.mean, told)


AWR = galton.Algorithm("awr", "AWR", update, (*actor_critic.SCALARS, "largest_weight"))
galton.ALGORITHMS["awr"] = AWR

if __name__ == "__main__":
    galton.use_all_cores()
    for loss in ("gaussian", "hl-gauss"):
        config = AWR.config(loss=loss, n_steps=64, net_arch=(), n_bins=41)
        result = galton.train("bandit", config, AWR.hypers(learning_rate=0.01, eta=0.75), range(20), 20_000, n_logs=20)
        print(f"{loss:9} final training return {result.final('training_return').mean():.2f} of 25")
