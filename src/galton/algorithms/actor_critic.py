"""What every actor-critic does: networks that act and value, advantages, and the clipped Adam step.

Separate networks for actor and critic, Adam, and the gradient's global norm clipped, as in Stable-Baselines3.
"""

from typing import NamedTuple

import jax
import jax.numpy as jnp
import optax
from jaxtyping import Array, Bool, Float, Key, PyTree

from galton import normalization
from galton.algorithms import entropy
from galton.algorithms.base import Agent, Scalars
from galton.losses import surrogate
from galton.networks import init_mlp, mlp
from galton.policies import Distribution, MovesOutputs
from galton.returns import gae
from galton.types import Hypers, Learner, Params, Transition

_ADAM = optax.scale_by_adam(b1=0.9, b2=0.999, eps=1e-5)


def init(key: Key[Array, ""], agent: Agent, hypers: Hypers, observation_size: int) -> Learner:
    """New networks and Adam's zeros. Not under vmap (see `init_mlp`)."""
    config, policy = agent.config, agent.policy
    actor_key, critic_key = jax.random.split(key)
    actor = init_mlp(actor_key, (observation_size, *config.net_arch, policy.n_outputs), last_scale=0.01)
    critic = init_mlp(
        critic_key, (observation_size, *config.net_arch, agent.critic.n_outputs), last_scale=agent.critic.init_scale
    )
    actor[-1]["bias"], extra = policy.init(hypers)
    params = {"actor": actor, "critic": critic, **extra}
    return Learner(params, _ADAM.init(params), normalization.init(config, observation_size), entropy.init(config))


def distribution(agent: Agent, params: Params, observation: Float[Array, "*batch o"], hypers: Hypers) -> Distribution:
    """π(· | s), from observations that are normalised already where they are to be."""
    return agent.policy.distribution(mlp(params["actor"], observation), params, hypers)


def act(
    agent: Agent, params: Params, observation: Float[Array, "*batch o"], noise: PyTree[Array], hypers: Hypers
) -> Float[Array, "*batch d"]:
    """A sampled action for each observation, from noise that the policy drew."""
    return distribution(agent, params, observation, hypers).sample(noise)


def value(
    agent: Agent, params: Params, observation: Float[Array, "*batch o"], hypers: Hypers
) -> Float[Array, "*batch"]:
    """What the critic takes each state to be worth, v(s)."""
    return agent.critic.value(mlp(params["critic"], observation), hypers)


def outputs(
    params: Params, observation: Float[Array, "B o"]
) -> tuple[Float[Array, "B n_actor"], Float[Array, "B n_critic"]]:
    """What the networks of actor and critic say of these observations.

    A barrier keeps XLA from computing softmaxes again inside the matrix products of the backward pass.
    """
    actor, critic = jax.lax.optimization_barrier(
        (mlp(params["actor"], observation), mlp(params["critic"], observation))
    )
    return actor, critic


def as_update_sees(
    agent: Agent, outputs: Float[Array, "B n_outputs"], key: Key[Array, ""], hypers: Hypers
) -> Float[Array, "B n_outputs"]:
    """The actor's outputs in an update: as they are, unless the policy moves them (RPO)."""
    policy = agent.policy
    return policy.moved(outputs, key, hypers) if isinstance(policy, MovesOutputs) else outputs


def advantages(
    values: Float[Array, " B"], next_values: Float[Array, " B"], batch: Transition, hypers: Hypers
) -> Float[Array, " B"]:
    """GAE over each environment's T steps; B = T · N, in the order of the batch `[T, N]`."""
    shape = batch.reward.shape
    advantage = jax.vmap(gae, in_axes=(1, 1, 1, 1, 1, None, None), out_axes=1)(
        batch.reward,
        values.reshape(shape),
        next_values.reshape(shape),
        batch.terminated,
        batch.truncated,
        hypers.gamma,
        hypers.gae_lambda,
    )
    return advantage.ravel()


def standardise(advantage: Float[Array, " B"]) -> Float[Array, " B"]:
    """Mean 0 and standard deviation 1 in this batch, as SB3's `normalize_advantage`."""
    return (advantage - advantage.mean()) / (advantage.std(ddof=1) + 1e-8)


class Objective(NamedTuple):
    """What an update minimises on a batch, and the parts that it is the sum of."""

    total: Float[Array, ""]
    policy_loss: Float[Array, ""]
    value_loss: Float[Array, ""]
    entropy: Float[Array, ""]
    """Mean over the batch, in nats, summed over action dimensions."""


def objective(
    distribution: Distribution,
    loss: Float[Array, " B"],
    weight: Float[Array, " B"],
    critic_loss: Float[Array, " B"],
    hypers: Hypers,
) -> Objective:
    """mean(weight · loss) + vf_coef · mean(critic_loss) − ent_coef · entropy.

    The weight is A2C's advantage; PPO's has the likelihood ratio in it.
    """
    policy_loss = surrogate(weight, loss)
    value_loss = jnp.mean(critic_loss)
    entropy = jnp.mean(distribution.entropy())
    total = policy_loss + hypers.vf_coef * value_loss - hypers.ent_coef * entropy
    return Objective(total, policy_loss, value_loss, entropy)


def step(
    agent: Agent, learner: Learner, gradient: Params, hypers: Hypers, going: Bool[Array, ""] | bool = True
) -> tuple[Learner, Float[Array, ""]]:
    """One Adam step along the gradient, scaled down to max_grad_norm; also the norm before that, of all of it.

    A gradient that is not finite moves no parameter; the norm tells. Where `going` is False nothing changes at all.
    """
    grad_norm = optax.tree.norm(gradient)
    finite = jnp.isfinite(grad_norm)
    learning_rate = jnp.where(finite, hypers.learning_rate, 0.0)
    of_critic = {"critic": gradient["critic"]}
    of_actor = {name: part for name, part in gradient.items() if name != "critic"}
    clipped: Params = {}
    for part in (of_actor, of_critic) if agent.config.clip_separately else (gradient,):
        scale = jnp.minimum(1.0, hypers.max_grad_norm / (optax.tree.norm(part) + 1e-6))
        clipped |= jax.tree.map(lambda g, scale=scale: jnp.where(finite, scale * g, 0.0), part)
    move, optimizer = _ADAM.update(clipped, learner.optimizer)
    params = jax.tree.map(lambda p, s: p - learning_rate * s, learner.params, move)
    if going is not True:
        old = (learner.params, learner.optimizer)
        params, optimizer = jax.tree.map(lambda new, kept: jnp.where(going, new, kept), (params, optimizer), old)
    return learner._replace(params=params, optimizer=optimizer), grad_norm


def flatten(steps: Float[Array, "T N *n"]) -> Float[Array, "B *n"]:
    """One row per transition: matrix products over one axis are faster than over two."""
    return steps.reshape(-1, *steps.shape[2:])


def scalars(parts: Objective, grad_norm: Float[Array, ""]) -> Scalars:
    """What every actor-critic tells of a step; all are of the parameters before it."""
    return {
        "entropy": parts.entropy,
        "grad_norm": grad_norm,
        "policy_loss": parts.policy_loss,
        "value_loss": parts.value_loss,
    }


SCALARS = ("entropy", "grad_norm", "policy_loss", "value_loss")
"""Their names, in the order of the log."""
