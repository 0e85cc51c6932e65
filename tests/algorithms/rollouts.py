"""A made-up rollout and who acted in it."""

import jax
import jax.numpy as jnp
import numpy as np

from galton.algorithms import actor_critic
from galton.types import Transition

from ..agents import agent as agent_on

LOW, HIGH = np.array([-1.0, -2.0]), np.array([1.0, 2.0])
T, N, SIZE = 4, 3, 5


def setup(loss, **words):
    """An agent, its learner and a rollout that it sampled, without ends of episodes."""
    agent = agent_on({"loss": loss, "n_bins": 10, "n_steps": T, "n_envs": N, **words}, low=LOW, high=HIGH)
    return agent, *_begun(agent)


@jax.jit
def _begun(agent):
    learner = actor_critic.init(jax.random.key(0), agent, SIZE)
    keys = jax.random.split(jax.random.key(1), 4)
    observation = jax.random.normal(keys[0], (T, N, SIZE))
    return learner, Transition(
        observation,
        actor_critic.act(agent, learner.params, observation, agent.policy.noise(keys[1], (T, N))),
        jax.random.normal(keys[2], (T, N)),
        jax.random.normal(keys[3], (T, N, SIZE)),
        jnp.zeros((T, N), bool),
        jnp.zeros((T, N), bool),
    )


@jax.jit
def update(agent, learner, batch):
    """The learner after an update, in which nothing is random, and what it tells."""
    return agent.algorithm.update(agent, learner, batch, jax.random.key(2))
