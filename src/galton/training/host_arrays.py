"""The arrays of a rollout outside JAX, and the seeds of its environments."""

from typing import Any

import numpy as np
from jaxtyping import UInt

from galton.training.log import Finished
from galton.types import Transition

Shape = tuple[int, int, int]
"""P runs, T steps, N copies."""


def empty_batch(shape: Shape, o: int, d: int) -> Transition:
    """Room for the transitions of a rollout, each array `[P, T, N, ...]`."""
    numbers = (np.zeros((*shape, *entries), np.float32) for entries in ((o,), (d,), (), (o,)))
    return Transition._make([*numbers, np.zeros(shape, bool), np.zeros(shape, bool)])


def empty_finished(shape: Shape) -> Finished:
    """Room for what a rollout tells of its episodes, each array `[P, T, N]`."""
    return Finished._make([np.zeros(shape, dtype) for dtype in (bool, np.float32, np.int32)])


def environment_seeds(seeds: UInt[np.ndarray, " P"], n: int, *purpose: int) -> UInt[np.ndarray, " M"]:
    """Seeds for n copies of each run: for training (0), evaluation at a step (1, step) or new episodes (2, step)."""
    sequences: list[Any] = [np.random.SeedSequence((int(seed), *purpose)) for seed in seeds]
    return np.concatenate([sequence.generate_state(n) for sequence in sequences])
