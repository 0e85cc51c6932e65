"""The population for an environment."""

from collections.abc import Sequence
from typing import Any

from galton.envs.base import Environment
from galton.envs.find import find
from galton.training.host import HostPopulation
from galton.training.population import Population
from galton.training.scan import ScanPopulation
from galton.types import Config, Hypers


def populate(env: Any, config: Config, hypers: Hypers, seeds: Sequence[int], interval: int) -> Population:
    """R new runs, one per seed, with hypers `[R]` each.

    Args:
        env: what `galton.envs.find` takes.
        config: shared by all runs.
        hypers: each field `[R]`.
        seeds: R integers.
        interval: updates between log points.
    """
    found = find(env)
    if isinstance(found, Environment):
        return ScanPopulation(found, config, hypers, seeds, interval)
    return HostPopulation(found, config, hypers, seeds)
