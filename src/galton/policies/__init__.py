"""Policies: distributions over a box of actions. A new one is a file here and a line in POLICIES."""

from collections.abc import Callable

import numpy as np
from jaxtyping import Float

from galton.policies.base import Distribution, Policy
from galton.policies.gaussian import Gaussian, GaussianPolicy
from galton.policies.histogram import Histogram, HistogramPolicy
from galton.types import Config

Box = Float[np.ndarray, " d"]

POLICIES: dict[str, Callable[[Config, Box, Box], Policy]] = {
    "gaussian": GaussianPolicy.create,
    "histogram": HistogramPolicy.create,
}

__all__ = ["POLICIES", "Distribution", "Gaussian", "GaussianPolicy", "Histogram", "HistogramPolicy", "Policy"]
