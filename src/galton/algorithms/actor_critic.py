"""Actor-critics have these in common: networks that act and value, advantages, and the clipped step.

Separate networks for actor and critic, and the gradient's global norm clipped, as in Stable-Baselines3.
"""

from typing import NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Key, PyTree

from galton import normalization
from galton.algorithms.base import Agent, Scalars, name_of
from galton.critics import CRITICS
from galton.errors import require
from galton.losses import LOSSES, surrogate
from galton.policies import POLICIES, Distribution, Maskable, MovesOutputs, Sequential
from galton.returns import gae
from galton.types import Learner, Params, Transition


def init(key: Key[Array, ""], agent: Agent, observation_size: int) -> Learner:
    """New networks and the optimizer's first state. Not under vmap (see `networks.last_layer`)."""
    actor_key, critic_key = jax.random.split(key)
    network, policy, critic, rollout = agent.network, agent.policy, agent.critic, agent.rollout
    n_in = observation_size - agent.box.n_mask
    actor = network.init(actor_key, n_in, policy.n_outputs, 0.01, of_critic=False)
    of_critic = network.init(critic_key, n_in, critic.n_outputs, critic.init_scale, of_critic=True)
    first, extra = policy.init()
    actor[-1]["bias"] = first if policy.head_scale is None else first / policy.head_scale
    params = {"actor": actor, "critic": of_critic, **extra}
    _check_shapes(agent, params)
    return Learner(
        params,
        agent.optimizer.init(params),
        normalization.init(n_in, rollout.n_envs, rollout.normalize_observation, rollout.normalize_reward),
        {"algorithm": agent.algorithm.init(agent, params), "entropy": agent.entropy.init()},
    )


def _check_shapes(agent: Agent, params: Params) -> None:
    """Raise UsageError for a loss or a critic that does not give one number for each of two samples.

    Another shape would be broadcast against that of the weights or the returns, and train towards a wrong mean.
    """
    loss, critic = agent.loss, agent.critic
    outputs, action, of_critic = (jnp.zeros((2, n)) for n in (agent.policy.n_outputs, len(agent.low), critic.n_outputs))

    def told() -> dict[str, Array]:
        return {
            f"loss {name_of(loss, LOSSES)!r}": loss(as_update_sees(agent, outputs, params, action), action),
            f"critic {name_of(critic, CRITICS)!r}, whose loss": critic.loss(of_critic, jnp.zeros(2)),
            f"critic {name_of(critic, CRITICS)!r}, whose value": critic.value(of_critic),
        }

    for name, found in jax.eval_shape(told).items():
        require(found.shape == (2,), f"{name} of 2 samples has shape {found.shape}; it must have shape (2,)")


def distribution(agent: Agent, params: Params, observation: Float[Array, "*batch o"]) -> Distribution:
    """π(· | s), from observations that are normalised already where they are to be."""
    return agent.policy.distribution(actor_outputs(agent, params, observation), params)


def actor_outputs(
    agent: Agent, params: Params, observation: Float[Array, "*batch o"]
) -> Float[Array, "*batch n_outputs"]:
    """Return the actor's answer to these observations, as its policy takes it."""
    own, mask = apart(agent, observation)
    return policy_outputs(agent, agent.network(params["actor"], own), mask)


def apart(
    agent: Agent, observation: Float[Array, "*batch o"]
) -> tuple[Float[Array, "*batch n"], Float[Array, "*batch m"] | None]:
    """The networks see the first part of observations; the second is their action masks, None where there are none."""
    n_mask = agent.box.n_mask
    return (observation[..., :-n_mask], observation[..., -n_mask:]) if n_mask else (observation, None)


def policy_outputs(
    agent: Agent, outputs: Float[Array, "*batch n_outputs"], mask: Float[Array, "*batch m"] | None
) -> Float[Array, "*batch n_outputs"]:
    """The network's outputs as the policy takes them: scaled, and far below 0 for values that a mask forbids."""
    scaled = agent.policy.scaled(outputs)
    if mask is None:
        return scaled
    assert isinstance(agent.policy, Maskable)
    return agent.policy.masked(scaled, mask)


def act(
    agent: Agent, params: Params, observation: Float[Array, "*batch o"], noise: PyTree[Array]
) -> Float[Array, "*batch d"]:
    """A sampled action for each observation, from noise that the policy drew."""
    return distribution(agent, params, observation).sample(noise)


def value(agent: Agent, params: Params, observation: Float[Array, "*batch o"]) -> Float[Array, "*batch"]:
    """Return the critic's value of each state, v(s)."""
    return agent.critic.value(agent.network(params["critic"], apart(agent, observation)[0]))


def outputs(
    agent: Agent, params: Params, observation: Float[Array, "B o"]
) -> tuple[Float[Array, "B n_actor"], Float[Array, "B n_critic"]]:
    """The networks of actor and critic are asked about these observations; the actor's answer is scaled for its policy.

    A barrier keeps XLA from computing softmaxes again inside the matrix products of the backward pass.
    """
    own, mask = apart(agent, observation)
    actor, critic = jax.lax.optimization_barrier(
        (agent.network(params["actor"], own), agent.network(params["critic"], own))
    )
    return policy_outputs(agent, actor, mask), critic


def as_update_sees(
    agent: Agent,
    outputs: Float[Array, "*batch n_outputs"],
    params: Params,
    action: Float[Array, "*batch d"],
    key: Key[Array, ""] | None = None,
) -> Distribution:
    """The distribution of the actor's outputs in an update, given its actions where dimensions depend on others.

    Outputs are as they are, unless there is a key and the policy moves them (RPO).
    """
    policy = agent.policy
    seen = policy.moved(outputs, key) if key is not None and isinstance(policy, MovesOutputs) else outputs
    distribution = policy.distribution(seen, params)
    return distribution.given(action) if isinstance(distribution, Sequential) else distribution


def require_kl(agent: Agent) -> None:
    """Raise UsageError for a policy that can't say how far another one is from it."""
    policy, label = agent.policy.head, agent.algorithm.label
    require(
        policy.has_kl,
        f"policy is {name_of(policy, POLICIES)!r}, which has no KL divergence for {label} to bound; choose from "
        f"{', '.join(name for name, kind in POLICIES.items() if kind.has_kl)}",
    )


def advantages(
    agent: Agent, values: Float[Array, " B"], next_values: Float[Array, " B"], batch: Transition
) -> Float[Array, " B"]:
    """GAE over each environment's T steps; B = T · N, in the order of the batch `[T, N]`."""
    shape = batch.reward.shape
    advantage = jax.vmap(gae, in_axes=(1, 1, 1, 1, 1, None, None), out_axes=1)(
        batch.reward,
        values.reshape(shape),
        next_values.reshape(shape),
        batch.terminated,
        batch.truncated,
        agent.algorithm.gamma,
        agent.algorithm.gae_lambda,
    )
    return advantage.ravel()


def by_sign(
    weight: Float[Array, "*batch"], others: Float[Array, "*batch"], of_negatives: Float[Array, "*batch"] | None
) -> Float[Array, "*batch"]:
    """Each action's loss, by the sign of its weight."""
    return others if of_negatives is None else jnp.where(weight < 0, of_negatives, others)


class Objective(NamedTuple):
    """An update minimises `total` on a batch, a weighted sum of the other parts and the loss's own regularizer."""

    total: Float[Array, ""]
    policy_loss: Float[Array, ""]
    value_loss: Float[Array, ""]
    entropy: Float[Array, ""]
    """Mean over the batch, in nats, summed over action dimensions."""
    head_rates: Float[Array, " n_outputs"] | None = None
    """The factor of the last layer's learning rate for each output, which `Policy.head_rates` gives; None: 1."""


def objective(
    agent: Agent,
    learner: Learner,
    distribution: Distribution,
    loss: Float[Array, " B"],
    weight: Float[Array, " B"],
    critic_loss: Float[Array, " B"],
    credit: Float[Array, " B"] | None = None,
) -> Objective:
    """mean(weight · loss) + vf_coef · mean(critic_loss) − the entropy, weighted, + the loss's own regularizer.

    The weight is A2C's credit; PPO's has the likelihood ratio in it, and names the credit too.
    """
    credit = weight if credit is None else credit
    dual = learner.memory["entropy"]
    ent_coef = agent.entropy.coefficient(agent.algorithm.ent_coef, agent.policy, dual, distribution, credit)
    policy_loss = surrogate(weight, loss)
    value_loss = jnp.mean(critic_loss)
    entropy = jnp.mean(distribution.entropy())
    total = policy_loss + agent.algorithm.vf_coef * value_loss
    total = total if ent_coef is None else total - ent_coef * entropy
    regularizer = agent.loss.regularizer(distribution)
    total = total if regularizer is None else total + jnp.mean(regularizer)
    return Objective(total, policy_loss, value_loss, entropy, agent.policy.head_rates(distribution))


def step(
    agent: Agent, learner: Learner, gradient: Params, parts: Objective, going: Bool[Array, ""] | bool = True
) -> tuple[Learner, Scalars]:
    """The learner after one step along the gradient, and what every actor-critic tells of it.

    A gradient that is not finite moves no parameter; grad_norm tells. Where `going` is False nothing changes at all.
    """
    params, optimizer, grad_norm = agent.optimizer.step(learner.params, learner.optimizer, gradient)
    if parts.head_rates is not None:
        *hidden, new = params["actor"]
        old = learner.params["actor"][-1]
        rates = jnp.where(jnp.isfinite(grad_norm), parts.head_rates, 0.0)  # else it may be NaN where nothing moves
        last = jax.tree.map(lambda old, new: old + rates * (new - old), old, new)
        params = params | {"actor": [*hidden, last]}
    if going is not True:
        old = (learner.params, learner.optimizer)
        params, optimizer = jax.tree.map(lambda new, kept: jnp.where(going, new, kept), (params, optimizer), old)
    dual = learner.memory["entropy"]
    told = agent.entropy.told(agent.policy, dual, parts.entropy)
    dual = agent.entropy.follow(agent.policy, dual, parts.entropy, going & jnp.isfinite(grad_norm))
    learner = learner._replace(params=params, optimizer=optimizer).remembering(entropy=dual)
    return learner, told | {
        "entropy": parts.entropy,
        "grad_norm": grad_norm,
        "policy_loss": parts.policy_loss,
        "value_loss": parts.value_loss,
    }


def flatten(steps: Float[Array, "T N *n"]) -> Float[Array, "B *n"]:
    """One row per transition: matrix products over one axis are faster than over two."""
    return steps.reshape(-1, *steps.shape[2:])


SCALARS = ("entropy", "grad_norm", "policy_loss", "value_loss")
"""The names of what every actor-critic tells of a step, in the order of the log; all of the parameters before it."""
