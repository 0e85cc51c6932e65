"""Policies by name: how network outputs become distributions over a box of actions.

A new one is a class in a file and a line in POLICIES.
"""

from galton.policies.base import Correlatable, Distribution, Family, Policy
from galton.policies.gaussian import Gaussian, GaussianPolicy
from galton.policies.histogram import Histogram, HistogramPolicy
from galton.policies.ordinal import OrdinalPolicy

POLICIES: dict[str, type[Policy]] = {
    "gaussian": GaussianPolicy,
    "histogram": HistogramPolicy,
    "ordinal": OrdinalPolicy,
}

__all__ = [
    "POLICIES",
    "Correlatable",
    "Distribution",
    "Family",
    "Gaussian",
    "GaussianPolicy",
    "Histogram",
    "HistogramPolicy",
    "OrdinalPolicy",
    "Policy",
]
