"""Learning algorithms by name: pure functions on pytrees. A new one is a record in a file and a line in ALGORITHMS."""

import numpy as np
from jaxtyping import Float

from galton.algorithms import a2c, ppo
from galton.algorithms.base import Agent, Algorithm, Scalars
from galton.errors import UsageError, require
from galton.losses import find_loss
from galton.policies import POLICIES
from galton.types import Config

ALGORITHMS: dict[str, Algorithm] = {
    "a2c": a2c.ALGORITHM,
    "ppo": ppo.ALGORITHM,
}

__all__ = ["ALGORITHMS", "Agent", "Algorithm", "Scalars", "find_algorithm", "resolve"]


def resolve(config: Config, low: Float[np.ndarray, " d"], high: Float[np.ndarray, " d"]) -> Agent:
    """Look up what a configuration names, once and for all.

    Raises:
        UsageError: an unknown name, choices that don't fit together, or a setting that its algorithm can't use.
    """
    loss, algorithm = find_loss(config.loss), find_algorithm(config.algorithm)
    name = loss.policy if config.policy == "auto" else config.policy
    require(name in POLICIES, f"policy is {config.policy!r}; choose from auto, {', '.join(POLICIES)}")
    fitting = [known for known, policy in POLICIES.items() if loss.family in ("density", policy.family)]
    require(
        name in fitting,
        f"policy is {name!r}, but the loss {config.loss!r} needs a {loss.family}; choose from {', '.join(fitting)}",
    )
    for other in ALGORITHMS.values():
        for field in other.own if other is not algorithm else ():
            value = getattr(config, field, None)
            usual = value is None or value == getattr(Config, field)
            require(usual, f"{field} is {value}; it goes with algorithm {other.name!r}, not with {config.algorithm!r}")
    algorithm.check(config)
    box = (tuple(float(x) for x in np.asarray(bound, np.float32)) for bound in (low, high))
    return Agent(config, loss, POLICIES[name].create, algorithm, *box)


def find_algorithm(name: str) -> Algorithm:
    """The entry of that name; UsageError lists the names if there is none."""
    if name not in ALGORITHMS:
        raise UsageError(f"algorithm is {name!r}; choose from {', '.join(ALGORITHMS)}")
    return ALGORITHMS[name]
