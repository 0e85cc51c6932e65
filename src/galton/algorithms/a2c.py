"""Advantage actor-critic with the semantics of Stable-Baselines3's A2C and Adam (App. C.2)."""

from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
import optax
from jaxtyping import Array, Float, Key

from galton import normalization
from galton.losses import find_loss, surrogate
from galton.networks import init_mlp, mlp
from galton.policies import POLICIES, Distribution, Policy
from galton.returns import gae
from galton.types import Config, Hypers, Learner, Params, Transition

_ADAM = optax.scale_by_adam(b1=0.9, b2=0.999, eps=1e-5)


class Diagnostics(NamedTuple):
    """What one update tells of itself; scalars, taken before the step."""

    policy_loss: Float[Array, ""]
    value_loss: Float[Array, ""]
    entropy: Float[Array, ""]
    """Mean over the batch, in nats, summed over action dimensions."""
    grad_norm: Float[Array, ""]
    """Of actor and critic together, before clipping."""


def make_policy(config: Config, low: Float[np.ndarray, " d"], high: Float[np.ndarray, " d"]) -> Policy:
    """The policy that the configured loss trains, for actions in the box [low, high]."""
    return POLICIES[find_loss(config.loss).policy](config, low, high)


def init(key: Key[Array, ""], config: Config, policy: Policy, observation_size: int) -> Learner:
    """Separate actor and critic networks and Adam's zeros. Not under vmap (see `init_mlp`)."""
    actor_key, critic_key = jax.random.split(key)
    actor = init_mlp(actor_key, (observation_size, *config.net_arch, policy.n_outputs), last_scale=0.01)
    critic = init_mlp(critic_key, (observation_size, *config.net_arch, 1), last_scale=1.0)
    actor[-1]["bias"], extra = policy.init()
    params = {"actor": actor, "critic": critic, **extra}
    return Learner(params, _ADAM.init(params), normalization.init(config, observation_size))


def distribution(policy: Policy, params: Params, observation: Float[Array, "*batch o"]) -> Distribution:
    """π(· | s)."""
    return policy.distribution(mlp(params["actor"], observation), params)


def value(params: Params, observation: Float[Array, "*batch o"]) -> Float[Array, "*batch"]:
    """The critic's v(s)."""
    return mlp(params["critic"], observation)[..., 0]


def act(
    policy: Policy, params: Params, observation: Float[Array, "*batch o"], noise: Float[Array, "*batch n"]
) -> Float[Array, "*batch d"]:
    """A sampled action for each observation, from noise that `policy.noise` drew."""
    return distribution(policy, params, observation).sample(noise)


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


def update(
    config: Config, policy: Policy, learner: Learner, batch: Transition, hypers: Hypers
) -> tuple[Learner, Diagnostics]:
    """One gradient step on a rollout `[T, N]`: policy loss + vf_coef · value loss − ent_coef · entropy.

    A gradient that is not finite moves no parameter; `grad_norm` tells.
    """
    observation, next_observation, action = map(flatten, (batch.observation, batch.next_observation, batch.action))

    def objective(params: Params) -> tuple[Array, Diagnostics]:
        next_values = jax.lax.stop_gradient(value(params, next_observation))
        # The barrier keeps XLA from computing softmaxes again inside the matrix products of the backward pass.
        outputs, values = jax.lax.optimization_barrier((mlp(params["actor"], observation), value(params, observation)))
        fixed_values = jax.lax.stop_gradient(values)
        advantage = advantages(fixed_values, next_values, batch, hypers)
        returns = advantage + fixed_values
        if config.normalize_advantage:
            advantage = (advantage - advantage.mean()) / (advantage.std(ddof=1) + 1e-8)

        policy_distribution = policy.distribution(outputs, params)
        loss = find_loss(config.loss).function(policy_distribution, action, hypers.eta)
        policy_loss = surrogate(advantage, loss)
        value_loss = jnp.mean((returns - values) ** 2)
        entropy = jnp.mean(policy_distribution.entropy())
        total = policy_loss + hypers.vf_coef * value_loss - hypers.ent_coef * entropy
        return total, Diagnostics(policy_loss, value_loss, entropy, jnp.zeros(()))

    gradient, diagnostics = jax.grad(objective, has_aux=True)(learner.params)
    grad_norm = optax.tree.norm(gradient)
    finite = jnp.isfinite(grad_norm)
    scale = jnp.minimum(1.0, hypers.max_grad_norm / (grad_norm + 1e-6))
    learning_rate = jnp.where(finite, hypers.learning_rate, 0.0)
    gradient = jax.tree.map(lambda g: jnp.where(finite, scale * g, 0.0), gradient)
    step, optimizer = _ADAM.update(gradient, learner.optimizer)
    params = jax.tree.map(lambda p, s: p - learning_rate * s, learner.params, step)
    return learner._replace(params=params, optimizer=optimizer), diagnostics._replace(grad_norm=grad_norm)


def flatten(steps: Float[Array, "T N n"]) -> Float[Array, "B n"]:
    """One row per transition: matrix products over one axis are faster than over two."""
    return steps.reshape(-1, steps.shape[-1])
