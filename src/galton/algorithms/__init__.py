"""Learning algorithms by name, pure functions on pytrees.

A new one is a class of this kind, with the settings that it needs, and a line in ALGORITHMS; what every actor-critic
does is in actor_critic.
"""

from galton.algorithms import actor_critic as actor_critic
from galton.algorithms.a2c import A2C
from galton.algorithms.base import Agent as Agent
from galton.algorithms.base import Algorithm as Algorithm
from galton.algorithms.base import Rollout as Rollout
from galton.algorithms.base import Scalars as Scalars
from galton.algorithms.credit import CREDITS as CREDITS
from galton.algorithms.entropy import ENTROPIES as ENTROPIES
from galton.algorithms.ppo import PPO
from galton.algorithms.trpo import TRPO
from galton.algorithms.vmpo import VMPO
from galton.errors import require_word

ALGORITHMS: dict[str, type[Algorithm]] = {"a2c": A2C, "ppo": PPO, "trpo": TRPO, "v-mpo": VMPO}


def find_algorithm(name: str) -> type[Algorithm]:
    """The entry of that name; UsageError lists the names if there is none."""
    require_word("algorithm", name, ALGORITHMS)
    return ALGORITHMS[name]
