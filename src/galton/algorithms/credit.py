"""How an advantage becomes credit: what it weighs its action's loss by, how wide and of which shape the target is.

The choices of `Config` beside the loss, which any actor-critic can carry out: `weighting`, `eta_rule` and
`negative_target`. With all of them at their defaults the weight is the advantage and the loss is the agent's own.
"""

from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from galton.algorithms import actor_critic
from galton.algorithms.base import Agent, Algorithm
from galton.errors import UsageError, require
from galton.losses import LOSSES, Loss, hl_one_hot
from galton.records import defaults
from galton.types import Config, Hypers

LARGEST = 20.0
"""The most that AWR's weight may be, as in its authors' experiments."""

Losses = Float[Array, "*batch"]
OfNegatives = Losses | tuple[()]
"""The losses that count where the weight is negative; () where they are the same."""


def weights(config: Config, advantage: Float[Array, " B"], hypers: Hypers) -> Float[Array, " B"]:
    """What multiplies each action's loss, from the advantages of a batch.

    - "advantage": A, standardised where the configuration says so; so are the others' advantages.
    - "awr": min(exp(A / temperature), 20) (Peng et al., 2019).
    - "v-mpo": the softmax of A / temperature over the better half of the batch, and 0 for the others (Song et al.,
      2020). It is multiplied by B, so that the mean over the batch is V-MPO's sum. Of an odd number of rows the middle
      one is among the better, and so is what equals the worst of them.
    """
    if config.normalize_advantage:
        advantage = actor_critic.standardise(advantage)
    if config.weighting == "awr":
        return jnp.exp(jnp.minimum(advantage / hypers.temperature, np.log(LARGEST)))
    if config.weighting == "v-mpo":
        n = len(advantage)
        better = advantage >= jnp.sort(advantage)[n // 2]
        return n * jax.nn.softmax(advantage / hypers.temperature, where=better)
    return advantage


def with_width(config: Config, distribution: Any, hypers: Hypers) -> Hypers:
    """The numbers with the η that these distributions call for; `[*batch, d]` where it follows the policy.

    No gradient flows through it.
    """
    if config.eta_rule == "fixed":
        return hypers
    in_bins = jax.lax.stop_gradient(distribution.std()) / distribution.bins.width
    return hypers._replace(eta=jnp.clip(hypers.eta * in_bins, hypers.eta_min, hypers.eta_max))


def loss(agent: Agent, distribution: Any, action: Float[Array, "*batch d"], hypers: Hypers) -> Losses:
    """The agent's loss of each action, with the width that the configuration asks for."""
    return agent.loss.function(distribution, action, with_width(agent.config, distribution, hypers))


def of_negatives(config: Config, distribution: Any, action: Float[Array, "*batch d"], hypers: Hypers) -> OfNegatives:
    """The losses of actions with a negative weight, where they are other ones: those of HL-1-Hot."""
    return () if config.negative_target == "same" else hl_one_hot(distribution, action, hypers)


def by_sign(weight: Float[Array, "*batch"], others: Losses, of_negatives: OfNegatives) -> Losses:
    """Each action's loss, by the sign of its weight."""
    return others if isinstance(of_negatives, tuple) else jnp.where(weight < 0, of_negatives, others)


CHOICES = ("eta_rule", "negative_target", "weighting", "entropy_target")
"""The fields of Config that an algorithm carries out, and not a loss or a policy."""

NUMBERS = {
    "eta_rule": ("eta_min", "eta_max"),
    "weighting": ("temperature",),
    "entropy_target": ("entropy_start", "entropy_end", "entropy_steps", "entropy_rate", "entropy_alpha_min"),
}
"""The fields of Hypers that have a use only where such a choice is not at its default."""


def check(config: Config, chosen: Loss, algorithm: Algorithm) -> None:
    """Raise UsageError for a choice that the algorithm or the loss can't carry out."""
    usual = defaults(Config)
    made = {name: getattr(config, name) for name in CHOICES if getattr(config, name) != usual[name]}
    for name, value in made.items():
        require(
            name in algorithm.choices,
            f"{name} is {value!r}, which algorithm {algorithm.name!r} does not carry out; leave it at {usual[name]!r}",
        )
    for name in made.keys() & {"eta_rule", "negative_target"}:
        wide = ", ".join(known for known, entry in LOSSES.items() if entry.is_wide)
        require(
            chosen.is_wide,
            f"{name} is {made[name]!r}, but the targets of loss {config.loss!r} have no width; choose from {wide}",
        )
    require(
        not {"negative_target", "weighting"} <= made.keys(),
        f"negative_target is {config.negative_target!r}, but with weighting {config.weighting!r} no weight is negative;"
        " choose one of the two",
    )


def check_numbers(config: Config, hypers: Hypers) -> None:
    """Raise UsageError for a number without a use under these choices, and for an η that is bounded by nothing."""
    usual = defaults(Hypers)
    for choice, names in NUMBERS.items():
        idle = getattr(config, choice) == defaults(Config)[choice]
        for name in names if idle else ():
            given = np.atleast_1d(getattr(hypers, name))
            for value in given[given != given.dtype.type(usual[name])][:1]:
                raise UsageError(f"{name} is {value!s}, which has no use with {choice} at {getattr(config, choice)!r}")
    bounded = np.asarray(hypers.eta_min) <= np.asarray(hypers.eta_max)
    require(
        bool(np.all(bounded)), f"eta_min is {hypers.eta_min} and eta_max {hypers.eta_max}; eta_min must be the smaller"
    )
