"""Agents, learners, a rollout and gradients for the tests of PPO, in the precision that JAX is set to.

Agents are arguments of the programs, so those that differ in their numbers alone share them.
"""

import jax
import jax.numpy as jnp
import numpy as np

from galton.algorithms import actor_critic, ppo
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


prepare = jax.jit(ppo.prepare)
fit = jax.jit(ppo.fit)
update = jax.jit(lambda agent, learner, batch, key: agent.algorithm.update(agent, learner, batch, key))


@jax.jit
def moved(agent):
    """A learner away from its first parameters, at which every state's distribution is about the same."""
    learner = actor_critic.init(jax.random.key(0), agent, WIDTH)
    leaves, structure = jax.tree.flatten(learner.params)
    params = jax.tree.unflatten(structure, [x + 0.3 * normal(i, *x.shape) for i, x in enumerate(leaves)])
    return learner._replace(params=params)


def orders_of(n_epochs):
    """An order of the rollout's rows for each epoch."""
    return jnp.stack([jax.random.permutation(jax.random.key(i), T * N) for i in range(n_epochs)])


@jax.jit
def rollout_of(agent, learner):
    observation, noise = normal(100, T, N, WIDTH), agent.policy.noise(jax.random.key(101), (T, N))
    action = actor_critic.act(agent, learner.params, observation, noise)
    ended = jax.random.bernoulli(jax.random.key(102), 0.2, (2, T, N))
    return Transition(observation, action, normal(103, T, N), normal(104, T, N, WIDTH), ended[0], ended[1] & ~ended[0])


def first_moments(before, after):
    """The gradient of Adam's first step, whose first moment is a tenth of it."""
    assert int(before.optimizer.count) == 0
    assert int(after.optimizer.count) == 1
    return jax.tree.map(lambda moment: moment / 0.1, after.optimizer.mu)


def check_equal(ours, theirs, tolerance):
    """Array by array in float64, relative to its largest entry."""
    for a, b in zip(jax.tree.leaves(ours), jax.tree.leaves(theirs), strict=True):
        assert a.dtype == b.dtype == np.float64
        scale = float(np.abs(b).max())
        assert scale > 1e-6
        np.testing.assert_allclose(a, b, rtol=0, atol=tolerance * scale)


def check_the_first_minibatch_is_a2cs(agent):
    """Fail unless PPO's first step is A2C's on the same rows; the learner before it and after either.

    As steps that end their episodes with the return for a reward, the rows have the same advantages in A2C.
    """
    learner = moved(agent)
    rows, drawn = prepare(agent, learner, rollout_of(agent, learner)), orders_of(6)[5, :SIZE]
    after, _ = fit(agent, learner, rows, drawn[None])
    ends = np.ones((SIZE, 1), bool)
    column = jax.tree.map(lambda x: np.asarray(x)[drawn][:, None], rows)
    batch = Transition(column.observation, column.action, column.returns, column.observation, ends, ~ends)
    a2cs, _ = update(with_a2c(agent), learner, batch, jax.random.key(0))
    check_equal(first_moments(learner, after), first_moments(learner, a2cs), 1e-9)
    return after, a2cs
