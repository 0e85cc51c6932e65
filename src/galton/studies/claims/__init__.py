"""What the paper says that can be tested, beside what was measured."""

from galton.analysis.page import Claim
from galton.studies.base import Data
from galton.studies.claims import bandit, returns, settings, theory


def all_claims(data: Data) -> list[Claim]:
    """In the order of the paper."""
    return [
        returns.ends_higher(data),
        returns.learns_faster(data),
        returns.acrobot(data),
        returns.more_stable(data),
        theory.bounds_hold(data),
        theory.bound_is_smaller(data),
        theory.bound_varies_less(data),
        theory.sigma_explodes(data),
        bandit.less_sensitive_to_noise(data),
        bandit.degrades_with_dimension(data),
        bandit.higher_in_all_dimensions(data),
        bandit.init_gaussian(data),
        bandit.gaussian_exploration(data),
        bandit.no_local_optimum(data),
        bandit.exploration_is_not_the_reason(data),
        returns.order_changes(data),
        *settings.sensitivities(data),
        settings.robust_to_settings(data),
        settings.higher_fraction(data),
    ]
