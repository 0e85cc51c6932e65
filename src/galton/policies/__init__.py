"""Policies by name: how network outputs become distributions over a box of actions.

A new one is a class in a file and a line in POLICIES.
"""

from galton.policies.autoregressive import Autoregressive as Autoregressive
from galton.policies.autoregressive import AutoregressivePolicy as AutoregressivePolicy
from galton.policies.base import Correlatable as Correlatable
from galton.policies.base import Distribution as Distribution
from galton.policies.base import Family as Family
from galton.policies.base import Maskable as Maskable
from galton.policies.base import MovesOutputs as MovesOutputs
from galton.policies.base import Policy as Policy
from galton.policies.base import Sequential as Sequential
from galton.policies.beta import Beta as Beta
from galton.policies.beta import BetaPolicy as BetaPolicy
from galton.policies.binned import BinnedPolicy as BinnedPolicy
from galton.policies.binned import HistogramPolicy as HistogramPolicy
from galton.policies.clipped_gaussian import ClippedGaussian as ClippedGaussian
from galton.policies.clipped_gaussian import ClippedGaussianPolicy as ClippedGaussianPolicy
from galton.policies.discretised_gaussian import AnchoredPolicy as AnchoredPolicy
from galton.policies.discretised_gaussian import DiscretisedGaussianPolicy as DiscretisedGaussianPolicy
from galton.policies.full_gaussian import FullGaussian as FullGaussian
from galton.policies.full_gaussian import FullGaussianPolicy as FullGaussianPolicy
from galton.policies.gaussian import Gaussian as Gaussian
from galton.policies.gaussian import GaussianHead as GaussianHead
from galton.policies.gaussian import GaussianPolicy as GaussianPolicy
from galton.policies.histogram import Histogram as Histogram
from galton.policies.joint import JointPolicy as JointPolicy
from galton.policies.ordinal import OrdinalPolicy as OrdinalPolicy
from galton.policies.rpo import RpoPolicy as RpoPolicy
from galton.policies.smoothed import SmoothedPolicy as SmoothedPolicy
from galton.policies.spline import Spline as Spline
from galton.policies.spline import SplinePolicy as SplinePolicy
from galton.policies.squashed_gaussian import SquashedGaussian as SquashedGaussian
from galton.policies.squashed_gaussian import SquashedGaussianPolicy as SquashedGaussianPolicy
from galton.policies.truncated_gaussian import TruncatedGaussian as TruncatedGaussian
from galton.policies.truncated_gaussian import TruncatedGaussianPolicy as TruncatedGaussianPolicy

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
