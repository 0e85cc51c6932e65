"""Proximal policy optimisation with the semantics of Stable-Baselines3's PPO (Schulman et al., 2017), for any loss.

A2C minimises mean(A · loss). PPO goes through a rollout several times, so that the policy π leaves π_old, the one that
sampled; its surrogate min(r A, clip(r) A) with r = π / π_old has the gradient A · r · [not clipped] · ∇ log π(a).

Galton puts the loss in the place of −log π(a), and so PPO is A2C's line again, with another weight:
mean(stop_gradient(A · r · [not clipped]) · loss). For a negative log-likelihood (the Gaussian's, HL-1-Hot) this is PPO
to the letter. For a histogram target there are two ratios, `PPO.ratio`:

- "smoothed": r = exp(loss_old − loss), the ratio of what the loss measures, with targets from the policy that sampled.
  Clipping then holds what the loss moves, neighbouring bins included. A loss with a bias, plain HL-Gauss, runs away
  without it (docs/ppo.md), so "auto" takes it there.
- "true": r = π(a) / π_old(a), with targets from the policy in training. A constant added to the advantages then does
  not move centred HL-Gauss's mean gradient in any epoch, while nothing is clipped. "auto" takes it for the others.
"""

import math
from collections.abc import Mapping
from typing import Annotated, Any, ClassVar, Literal, NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int, Key

from galton.algorithms import actor_critic, minibatches
from galton.algorithms.actor_critic import Objective, by_sign, flatten
from galton.algorithms.base import CARRIED_OUT, Agent, Algorithm, Scalars
from galton.critics import SquaredErrorCritic
from galton.errors import require
from galton.fields import Within
from galton.optimizers import count
from galton.parts import unusual
from galton.types import Count, Learner, Number, Params, Transition

_OF_MOVES = 2**31 - 1
"""Folded into an update's key it gives that of what its minibatches draw; the epochs' orders have 0 … n_epochs − 1."""
Told = dict[str, Float[Array, "*minibatches"]]
"""The scalars that minibatches report, by name."""


class Rows(NamedTuple):
    """A rollout as training data, a row per transition, all fixed before the first step."""

    observation: Float[Array, "B o"]
    action: Float[Array, "B d"]
    advantage: Float[Array, " B"]
    returns: Float[Array, " B"]
    """The returns that the critic is trained towards."""
    log_prob: Float[Array, " B"]
    """Each action's log-probability under the policy that sampled it."""
    loss: Float[Array, " B"]
    """The loss of each action under the policy that sampled it."""
    target: Float[Array, "B d k"] | None
    """The weights of a cross-entropy under that policy; None where the ratio does not need them."""
    of_negatives: Float[Array, " B"] | None = None
    """The loss under that policy of an action that is weighted negatively; None where it is the same."""
    value: Float[Array, " B"] | None = None
    """The critic's value of each state then; None where no run of the program clips its change."""


class PPO(Algorithm):
    """n_epochs passes over a rollout `[T, N]`, each in minibatches of batch_size in an order drawn from the key."""

    name: ClassVar[str] = "ppo"
    label: ClassVar[str] = "PPO"
    scalars: ClassVar[tuple[str, ...]] = (
        *actor_critic.SCALARS,
        *("approx_kl", "clip_fraction", "ratio_mean", "ratio_max", "n_minibatches"),
    )
    defaults: ClassVar[Mapping[str, Any]] = {
        "learning_rate": 3e-4,
        "n_steps": 2048,
        "gae_lambda": 0.95,
        "normalize_advantage": True,
    }
    log_interval: ClassVar[int] = 1
    side_by_side: ClassVar[bool] = False
    choices: ClassVar[tuple[str, ...]] = CARRIED_OUT

    n_epochs: Count = 10
    """The number of passes over each rollout."""
    batch_size: Count = 64
    """Steps in each minibatch; it divides n_steps · n_envs."""
    ratio: Literal["auto", "smoothed", "true"] = "auto"
    """The ratio that is clipped: of what the loss measures, or the actions' own likelihood ratio; auto is smoothed for
    a loss with a bias, plain HL-Gauss, and true for all others."""
    clip_range: Annotated[Number, Within(lambda x: x >= 0, "0 or more")] = 0.2
    """The ratio is clipped this far from 1."""
    clip_range_vf: Annotated[Number | None, Within(lambda x: x >= 0, "0 or more, or inf for none")] = math.inf
    """The critic's loss sees each value clipped to this far from what it was when the rollout was sampled, in the units
    of the rewards that the critic sees. It goes with the critic 'squared-error'."""
    target_kl: Annotated[Number, Within(lambda x: x > 0, "greater than 0, or inf for none")] = math.inf
    """A rollout is left off once its approximate KL divergence from the sampling policy exceeds 1.5 of this."""

    def update(self, agent: Agent, learner: Learner, batch: Transition, key: Key[Array, ""]) -> tuple[Learner, Scalars]:
        """The learner after all minibatches, and what they tell."""
        rows = prepare(agent, learner, batch)
        orders = minibatches.orders(key, self.n_epochs, len(rows.advantage))
        return fit(agent, learner, rows, orders, jax.random.fold_in(key, _OF_MOVES))

    def check(self, agent: Agent) -> None:
        """Raise UsageError unless the minibatches divide a rollout."""
        minibatches.require_whole(agent, self.batch_size)
        require(
            not agent.credit.normalize_advantage or self.batch_size > 1,
            "normalize_advantage needs more than one step in a minibatch: raise batch_size",
        )
        clips = unusual(self.clip_range_vf, math.inf)
        require(
            not clips or type(agent.critic).value is SquaredErrorCritic.value,
            f"clip_range_vf is {clips}, but critic {agent.critic.label!r} has no one value to clip; leave it at inf "
            "or take critic='squared-error'",
        )
        agent.entropy.check(self.batch_size, "batch_size")


def prepare(agent: Agent, learner: Learner, batch: Transition) -> Rows:
    """Advantages, returns, log-probabilities and targets under the parameters that sampled the rollout."""
    observation, next_observation, action = map(flatten, (batch.observation, batch.next_observation, batch.action))
    outputs, estimates = actor_critic.outputs(agent, learner.params, observation)
    values = agent.critic.value(estimates)
    next_values = actor_critic.value(agent, learner.params, next_observation)
    advantage = actor_critic.advantages(agent, values, next_values, batch)
    distribution = actor_critic.as_update_sees(agent, outputs, learner.params, action)
    target = agent.loss.target(distribution, action) if _is_smoothed(agent) else None
    loss = minibatches.loss(agent, distribution, action, target)
    of_negatives = agent.loss.of_negatives(distribution, action)
    log_prob = distribution.log_prob(action)
    kept = None if _of(agent).clip_range_vf is None else values
    return Rows(observation, action, advantage, advantage + values, log_prob, loss, target, of_negatives, kept)


def _is_smoothed(agent: Agent) -> bool:
    ratio = _of(agent).ratio
    return ratio == "smoothed" or (ratio == "auto" and agent.loss.is_biased)


def _of(agent: Agent) -> PPO:
    assert isinstance(agent.algorithm, PPO)
    return agent.algorithm


def fit(
    agent: Agent, learner: Learner, rows: Rows, orders: Int[Array, "epochs B"], key: Key[Array, ""] | None = None
) -> tuple[Learner, Scalars]:
    """A step on each minibatch of each epoch, until one's KL divergence is over 1.5 · target_kl, or its gradient NaN.

    The key is for policies that move their outputs; each minibatch has its own, by the optimizer's count of steps. By
    default it is that of seed 0.
    """
    key = jax.random.key(0) if key is None else key
    size = _of(agent).batch_size

    def epoch(carry: tuple[Learner, Array], order: Array) -> tuple[tuple[Learner, Array], tuple[Array, Told]]:
        batches = jax.tree.map(lambda x: x[order].reshape(-1, size, *x.shape[1:]), rows)
        return jax.lax.scan(lambda carry, rows: _minibatch(agent, carry, rows, key), carry, batches)

    (learner, _), (taken, told) = jax.lax.scan(epoch, (learner, jnp.array(True)), orders)
    return learner, _summarise(taken, told)


def _minibatch(
    agent: Agent, carry: tuple[Learner, Array], rows: Rows, key: Key[Array, ""]
) -> tuple[tuple[Learner, Array], tuple[Array, Scalars]]:
    """One step, unless training on this rollout has been left off: (learner, going) → the same, and what it tells."""
    (learner, looking), algorithm = carry, _of(agent)
    advantage = agent.credit.weights(rows.advantage)

    def objective(params: Params) -> tuple[Array, tuple[Objective, Array, Array]]:
        outputs, estimates = actor_critic.outputs(agent, params, rows.observation)
        own_key = jax.random.fold_in(key, count(learner.optimizer))
        distribution = actor_critic.as_update_sees(agent, outputs, params, rows.action, own_key)
        of_negatives = agent.loss.of_negatives(distribution, rows.action)
        loss = by_sign(advantage, minibatches.loss(agent, distribution, rows.action, rows.target), of_negatives)
        sampled_loss = by_sign(advantage, rows.loss, rows.of_negatives)
        log_ratio = jax.lax.stop_gradient(distribution.log_prob(rows.action) - rows.log_prob)
        ratio = jnp.exp(jax.lax.stop_gradient(sampled_loss - loss) if _is_smoothed(agent) else log_ratio)
        weight = advantage * gated(ratio, advantage, algorithm.clip_range)
        if rows.value is not None and (most := algorithm.clip_range_vf) is not None:
            within = jnp.clip(estimates[:, 0] - rows.value, -most, most)
            estimates = (rows.value + within)[:, None]
        critic_loss = agent.critic.loss(estimates, rows.returns)
        parts = actor_critic.objective(agent, learner, distribution, loss, weight, critic_loss, credit=advantage)
        return parts.total, (parts, ratio, log_ratio)

    gradient, (parts, ratio, log_ratio) = jax.grad(objective, has_aux=True)(learner.params)
    approximate_kl = jnp.mean(jnp.exp(log_ratio) - 1 - log_ratio)
    going = looking & ~(approximate_kl > 1.5 * algorithm.target_kl)  # one that is not a number shows in the gradient
    learner, told = actor_critic.step(agent, learner, gradient, parts, going)
    clipped = jnp.clip(ratio, 1 - algorithm.clip_range, 1 + algorithm.clip_range)
    finite = jnp.isfinite(told["grad_norm"])
    told |= {
        "grad_norm": jnp.where(going, told["grad_norm"], 0.0),
        "policy_loss": -jnp.mean(jnp.minimum(advantage * ratio, advantage * clipped)),
        "approx_kl": approximate_kl,
        "clip_fraction": jnp.mean(jnp.abs(ratio - 1) > algorithm.clip_range),
        "ratio_mean": ratio.mean(),
        "ratio_max": ratio.max(),
        "n_minibatches": going.astype(jnp.float32),
    }
    return (learner, going & finite), (looking, told)


def gated(
    ratio: Float[Array, " B"], advantage: Float[Array, " B"], clip_range: Float[Array, ""] | float
) -> Float[Array, " B"]:
    """The ratio where min(r A, clip(r) A) still has a slope, 0 where it is clipped."""
    clipped = jnp.where(advantage > 0, ratio > 1 + clip_range, ratio < 1 - clip_range)
    return jnp.where(clipped, 0.0, ratio)


def _summarise(looked_at: Bool[Array, "epochs batches"], told: Told) -> Scalars:
    """Means over the minibatches that were looked at; the KL divergence of the last epoch that was, as SB3's.

    n_minibatches is how many were learnt from: all, unless target_kl left some off.
    """
    last = looked_at & (jnp.arange(len(looked_at)) == looked_at.any(1).sum() - 1)[:, None]
    means = {name: _mean(values, looked_at) for name, values in told.items()}
    return means | {
        "grad_norm": told["grad_norm"].sum() / jnp.maximum(told["n_minibatches"].sum(), 1),
        "approx_kl": _mean(told["approx_kl"], last),
        "ratio_max": jnp.where(looked_at, told["ratio_max"], 0.0).max(),
        "n_minibatches": told["n_minibatches"].sum(),
    }


def _mean(values: Float[Array, "epochs batches"], where: Bool[Array, "epochs batches"]) -> Float[Array, ""]:
    return jnp.where(where, values, 0.0).sum() / where.sum()
