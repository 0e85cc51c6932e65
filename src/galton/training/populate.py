"""The population for an environment."""

from collections.abc import Sequence
from typing import Any

import jax

from galton.envs.base import Environment
from galton.envs.find import find
from galton.training.host import HostPopulation
from galton.training.population import Population
from galton.training.scan import ScanPopulation
from galton.types import Config, Hypers


def populate(
    env: Any,
    config: Config,
    hypers: Hypers,
    seeds: Sequence[int],
    interval: int,
    devices: Sequence[jax.Device] | None = None,
) -> Population:
    """R new runs, one per seed, with hypers `[R]` each.

    Args:
        env: what `galton.envs.find` takes.
        config: shared by all runs.
        hypers: each field `[R]`.
        seeds: R integers.
        interval: updates between log points.
        devices: what to compute on; by default, on all of this process.
    """
    found, devices = find(env), devices or jax.devices()
    if isinstance(found, Environment):
        return ScanPopulation(found, config, hypers, seeds, interval, devices)
    return HostPopulation(found, config, hypers, seeds, devices)
