"""Policies by name: how network outputs become distributions over a box of actions.

A new one is a class in a file and a line in POLICIES.
"""

from galton.policies.autoregressive import Autoregressive, AutoregressivePolicy
from galton.policies.base import (
    Correlatable,
    Distribution,
    Divergent,
    Family,
    Maskable,
    MovesOutputs,
    Policy,
    Sequential,
)
from galton.policies.beta import Beta, BetaPolicy
from galton.policies.binned import BinnedPolicy, HistogramPolicy
from galton.policies.clipped_gaussian import ClippedGaussian, ClippedGaussianPolicy
from galton.policies.discretised_gaussian import AnchoredPolicy, DiscretisedGaussianPolicy
from galton.policies.full_gaussian import FullGaussian, FullGaussianPolicy
from galton.policies.gaussian import Gaussian, GaussianHead, GaussianPolicy
from galton.policies.histogram import Histogram
from galton.policies.joint import JointPolicy
from galton.policies.ordinal import OrdinalPolicy
from galton.policies.rpo import RpoPolicy
from galton.policies.smoothed import SmoothedPolicy
from galton.policies.spline import Spline, SplinePolicy
from galton.policies.squashed_gaussian import SquashedGaussian, SquashedGaussianPolicy
from galton.policies.truncated_gaussian import TruncatedGaussian, TruncatedGaussianPolicy

POLICIES: dict[str, type[Policy]] = {
    "gaussian": GaussianPolicy,
    "histogram": HistogramPolicy,
    "ordinal": OrdinalPolicy,
    "smoothed": SmoothedPolicy,
    "discretised-gaussian": DiscretisedGaussianPolicy,
    "anchored": AnchoredPolicy,
    "clipped-gaussian": ClippedGaussianPolicy,
    "truncated-gaussian": TruncatedGaussianPolicy,
    "squashed-gaussian": SquashedGaussianPolicy,
    "beta": BetaPolicy,
    "rpo": RpoPolicy,
    "spline": SplinePolicy,
    "full-gaussian": FullGaussianPolicy,
    "joint": JointPolicy,
    "autoregressive": AutoregressivePolicy,
}

__all__ = [
    "POLICIES",
    "AnchoredPolicy",
    "Autoregressive",
    "AutoregressivePolicy",
    "Beta",
    "BetaPolicy",
    "BinnedPolicy",
    "ClippedGaussian",
    "ClippedGaussianPolicy",
    "Correlatable",
    "DiscretisedGaussianPolicy",
    "Distribution",
    "Divergent",
    "Family",
    "FullGaussian",
    "FullGaussianPolicy",
    "Gaussian",
    "GaussianHead",
    "GaussianPolicy",
    "Histogram",
    "HistogramPolicy",
    "JointPolicy",
    "Maskable",
    "MovesOutputs",
    "OrdinalPolicy",
    "Policy",
    "RpoPolicy",
    "Sequential",
    "SmoothedPolicy",
    "Spline",
    "SplinePolicy",
    "SquashedGaussian",
    "SquashedGaussianPolicy",
    "TruncatedGaussian",
    "TruncatedGaussianPolicy",
]
