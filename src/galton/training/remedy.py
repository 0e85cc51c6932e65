"""What to do about a gradient that was not finite, by what can be seen of its cause."""

import numpy as np

from galton.algorithms import Agent
from galton.normalization import Moments
from galton.types import Learner

WIDE = 1e18
"""Of an action dimension: the square of anything wider comes near the end of float32, 3.4e38."""


def remedy(agent: Agent, learner: Learner) -> str:
    """A sentence that names the cause, if it is numbers that are too large, and otherwise what may help.

    Args:
        agent: of the run.
        learner: of one run, or of several.
    """
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
    off = [name for name in ("normalize_reward", "normalize_observation") if not getattr(agent.config, name)]
    return f"Lower learning_rate{''.join(f', or set {name}' for name in off)}"


def _overflowed(moments: Moments | tuple[()]) -> bool:
    """Whether running statistics, where they are kept, hold something that is not finite."""
    return bool(moments) and not all(np.isfinite(part).all() for part in moments)
