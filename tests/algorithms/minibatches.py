"""Agents, learners and a rollout for the tests of PPO, in the precision that JAX is set to."""

import jax
import numpy as np

from galton.algorithms import actor_critic
from galton.algorithms.a2c import A2C
from galton.parts import settings
from galton.types import Transition

from ..agents import agent as agent_on

LOW, HIGH = np.array([-1.0, -2.0]), np.array([1.0, 2.0])
T, N, SIZE, WIDTH, K = 8, 3, 6, 4, 10
"""Steps, copies, rows of a minibatch, entries of an observation, bins."""
SHAPES = {"n_bins": K, "n_steps": T, "n_envs": N, "net_arch": (16,), "batch_size": SIZE}
NUMBERS = {"learning_rate": 3e-3, "clip_range": 0.1, "ent_coef": 0.01, "max_grad_norm": 1e9}


def agent_of(policy, loss, *, d=2, **words):
    return agent_on(
        {"algorithm": "ppo", "policy": policy, "loss": loss} | SHAPES | NUMBERS | words, low=LOW[:d], high=HIGH[:d]
    )


def with_a2c(agent):
    """The same agent, but trained by A2C."""
    return agent.replace(algorithm=A2C(**{name: getattr(agent.algorithm, name) for name in settings(A2C)}))


def normal(seed, *shape):
    return jax.random.normal(jax.random.key(seed), shape, float)


def fresh(agent, params):
    """A learner with these parameters and nothing in Adam's moments."""
    return actor_critic.init(jax.random.key(0), agent, WIDTH)._replace(params=params)


def moved(agent):
    """A learner away from its first parameters, at which every state's distribution is about the same."""
    learner = actor_critic.init(jax.random.key(0), agent, WIDTH)
    leaves, structure = jax.tree.flatten(learner.params)
    return fresh(agent, jax.tree.unflatten(structure, [x + 0.3 * normal(i, *x.shape) for i, x in enumerate(leaves)]))


def rollout_of(agent, learner):
    observation, noise = normal(100, T, N, WIDTH), agent.policy.noise(jax.random.key(101), (T, N))
    action = actor_critic.act(agent, learner.params, observation, noise)
    ended = jax.random.bernoulli(jax.random.key(102), 0.2, (2, T, N))
    return Transition(observation, action, normal(103, T, N), normal(104, T, N, WIDTH), ended[0], ended[1] & ~ended[0])
