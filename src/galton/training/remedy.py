"""Remedies for a gradient that was not finite, or a σ that grows, by what can be seen of the cause."""

import jax.numpy as jnp
import numpy as np

from galton.algorithms import Agent
from galton.normalization import Moments
from galton.policies.gaussian import Gaussian
from galton.types import Learner

WIDE = 1e18
"""Of an action dimension: the square of anything wider comes near the end of float32, 3.4e38."""

OUTGROWN = 3.0
"""In half-widths of the box: three quarters of the actions of a Gaussian around its middle are clipped, or more."""


def remedy(agent: Agent, learner: Learner) -> str:
    """A sentence that names the cause, if it is numbers that are too large, and otherwise what may help."""
    normalizer = learner.normalizer
    for moments, what, setting, wrapper in (
        (normalizer.observation, "observations", "normalize_observation", "TransformObservation"),
        (normalizer.discounted_return, "rewards", "normalize_reward", "TransformReward"),
    ):
        if _overflowed(moments):
            return (
                f"The {what} are so large that their variance overflowed in {setting}; scale them down in the "
                f"environment (gymnasium.wrappers.{wrapper})"
            )
    span = float(np.max(np.asarray(agent.high, np.float64) - np.asarray(agent.low, np.float64)))
    if span > WIDE:
        return (
            f"The action box is {span:.1e} wide, too wide to compute with in float32; wrap the environment so that it "
            "takes smaller actions (gymnasium.wrappers.RescaleAction)"
        )
    off = [name for name in ("normalize_reward", "normalize_observation") if not getattr(agent.rollout, name)]
    return f"Lower learning_rate{''.join(f', or set {name}' for name in off)}"


def outgrown(agent: Agent, learner: Learner) -> str:
    """The warning of a run whose Gaussian's σ has more than doubled and outgrown the box; empty where it has not."""
    means = jnp.zeros(agent.policy.n_outputs)
    first, now = (agent.policy.distribution(means, params) for params in (agent.policy.init()[1], learner.params))
    if not (isinstance(first, Gaussian) and isinstance(now, Gaussian)):
        return ""
    half_widths = np.asarray(now.sigma) * 2 / (np.asarray(now.high, np.float64) - now.low)
    if not ((half_widths > OUTGROWN) & (np.asarray(now.sigma) > 2 * np.asarray(first.sigma))).any():
        return ""
    ent_coef = float(agent.algorithm.ent_coef or 0)
    rate = f"lower ent_coef, which is {ent_coef:g}, or " if ent_coef else ""
    return (
        f"the Gaussian's σ has grown to {half_widths.max():.1f} half-widths of the action box, and most of its actions "
        f'are clipped; {rate}take policy="clipped-gaussian" or a head over bins, whose σ stays in the box'
    )


def _overflowed(moments: Moments | tuple[()]) -> bool:
    """True if running statistics, where they are kept, hold something that is not finite."""
    return bool(moments) and not all(np.isfinite(part).all() for part in moments)
