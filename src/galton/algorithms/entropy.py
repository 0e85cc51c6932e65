"""An entropy that is held: a bonus in units of the advantage, whose multiplier follows a target.

The surrogate mean(weight · loss) gets the bonus α · std(weight) · H. A reward that is c times as large makes both c
times as large, so that the same α means the same in every unit of reward.

The entropy is told as a share of the box, which means the same for every policy and in every number of dimensions:
e^(H/d) / k, or of a density e^(h/d) / (high − low). It is 1 for the uniform policy.

α is the multiplier of the constraint that the entropy equals its target, so it may have either sign. With the nats m
that a dimension's entropy is short of the target it is

    α = 0.2 · sinh(dual + 10 m), from entropy_alpha_min to 100, and dual ← dual + entropy_rate · m after each
    gradient step whose α was not at the bound already.

The dual variable climbs as that of soft actor-critic does (Haarnoja et al., 2018). By itself it would swing, for the
entropy needs many steps to follow; the part that is proportional to m damps it (Stooke et al., 2020). The sinh lets α
grow tenfold where the policy is about to collapse, and pass through 0. Against entropy α never outweighs the
advantages with the usual least α of −1: the policy narrows towards what they prefer. With a least α of 0 the entropy
may be anything above its target, the constraint of soft actor-critic. Neither Adam nor the clipping of gradients knows
of the dual variable.
"""

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int

from galton.algorithms.base import Agent, Scalars
from galton.errors import require
from galton.policies import Distribution
from galton.types import Config, Hypers, Learner

SCALE, GAIN = 0.2, 10.0
"""α with nothing in the sinh but 1, nearly, and how much a nat that is missing adds there."""
MOST = 100.0
"""The greatest α, however far the entropy is below its target."""
REACH = float(np.arcsinh(MOST / SCALE))
"""How far the dual variable may go either way, as far as α itself would."""


def init(config: Config) -> Float[Array, ""] | tuple[()]:
    """The first dual variable, 0; () where no entropy is held."""
    return jnp.zeros(()) if config.entropy_target else ()


def log_share(agent: Agent, entropy: Float[Array, "*batch"]) -> Float[Array, "*batch"]:
    """The logarithm of the share of the box that a uniform policy with this entropy fills in each dimension."""
    sizes = np.subtract(agent.high, agent.low, dtype=np.float64)
    if agent.policy.family == "histogram":
        sizes = np.full(len(sizes), float(agent.config.n_bins))
    return entropy / len(sizes) - float(np.log(sizes).mean())


def at_step(config: Config, hypers: Hypers, step: Int[Array, ""], frozen: Bool[Array, ""]) -> Hypers:
    """The numbers of the update at this step: entropy_start is its target. A frozen run's dual variable stays."""
    if not config.entropy_target:
        return hypers
    start, steps = jnp.asarray(hypers.entropy_start), jnp.asarray(hypers.entropy_steps)
    done = jnp.where(steps > 0, jnp.minimum(step / jnp.where(steps > 0, steps, 1.0), 1.0), 0.0)
    target = start * (hypers.entropy_end / start) ** done
    return hypers._replace(entropy_start=target, entropy_rate=jnp.where(frozen, 0.0, hypers.entropy_rate))


def missing(agent: Agent, entropy: Float[Array, ""], hypers: Hypers) -> Float[Array, ""]:
    """How many nats the entropy of a dimension is short of its target; negative above it."""
    return jnp.log(hypers.entropy_start) - log_share(agent, entropy)


def alpha(agent: Agent, learner: Learner, entropy: Float[Array, ""], hypers: Hypers) -> Float[Array, ""]:
    """The multiplier of a gradient step, at the entropy before it."""
    assert not isinstance(learner.dual, tuple)
    inside = jnp.clip(learner.dual + GAIN * missing(agent, entropy, hypers), -20.0, 20.0)
    return jnp.clip(SCALE * jnp.sinh(inside), hypers.entropy_alpha_min, MOST)


def with_bonus(
    agent: Agent, learner: Learner, distribution: Distribution, weight: Float[Array, " B"], hypers: Hypers
) -> Hypers:
    """The numbers with α · std(weight) added to ent_coef, where an entropy is held. No gradient flows through it."""
    if isinstance(learner.dual, tuple):
        return hypers
    entropy = jax.lax.stop_gradient(distribution.entropy().mean())
    return hypers._replace(ent_coef=hypers.ent_coef + alpha(agent, learner, entropy, hypers) * weight.std())


def follow(
    agent: Agent, learner: Learner, entropy: Float[Array, ""], hypers: Hypers, going: Bool[Array, ""]
) -> Learner:
    """The learner after a step of dual ascent on the policy's mean entropy.

    The dual variable stays where `going` is False, and where α is at the bound to which it would go on.
    """
    if isinstance(learner.dual, tuple):
        return learner
    short, now = missing(agent, entropy, hypers), alpha(agent, learner, entropy, hypers)
    spent = jnp.where(short > 0, now >= MOST, now <= hypers.entropy_alpha_min)
    moved = jnp.clip(learner.dual + hypers.entropy_rate * short, -REACH, REACH)
    return learner._replace(dual=jnp.where(going & ~spent, moved, learner.dual))


def scalars(agent: Agent, learner: Learner, entropy: Float[Array, ""], hypers: Hypers) -> Scalars:
    """What is told of an entropy that is held, under the names of `Agent.scalars`: its share of the box, and α."""
    if isinstance(learner.dual, tuple):
        return {}
    share = jnp.exp(log_share(agent, entropy))
    return {"entropy_share": share, "entropy_alpha": alpha(agent, learner, entropy, hypers)}


def check(config: Config, rows: int, remedy: str) -> None:
    """Raise UsageError unless a gradient step has rows enough for a standard deviation of advantages."""
    require(
        not config.entropy_target or rows > 1,
        f"entropy_target needs more than one step in each gradient step: raise {remedy}",
    )
