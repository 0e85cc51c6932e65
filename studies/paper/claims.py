"""The paper's claims are judged one by one, in the order of the page."""

from collections.abc import Callable
from functools import partial

from galton_experiments.page import Claim
from studies.paper import controls, harder_bandits, norms, order, profiles, returns, sensitivity
from studies.paper.norms import LIKELIHOOD, PRINTED
from studies.paper.trained import Trained

Judge = Callable[[Trained], Claim]
CLAIMS: list[tuple[str, Judge]] = [
    ("figure-2", returns.ends_higher),
    ("figure-2", returns.learns_faster),
    ("figure-2", returns.learns_sooner),
    ("figure-9", returns.acrobot),
    ("figure-2", order.alike_between_seeds),
    ("figure-2", order.keeps_what_it_learns),
    ("propositions", norms.bounds_hold),
    ("propositions", partial(norms.norm_is_smaller, reading=LIKELIHOOD)),
    ("propositions", partial(norms.norm_is_smaller, reading=PRINTED)),
    ("propositions", partial(norms.bound_is_smaller, reading=LIKELIHOOD)),
    ("propositions", partial(norms.bound_is_smaller, reading=PRINTED)),
    ("propositions", partial(norms.bound_varies_less, reading=LIKELIHOOD)),
    ("propositions", partial(norms.bound_varies_less, reading=PRINTED)),
    ("propositions", norms.sigma_explodes),
    ("figure-3", harder_bandits.less_sensitive_to_noise),
    ("figure-3", harder_bandits.degrades_with_dimension),
    ("figure-3", harder_bandits.higher_in_all_dimensions),
    ("figure-3", harder_bandits.gap_grows_with_dimension),
    ("figure-3", controls.starts_as_well),
    ("figure-3", controls.converges_faster),
    ("figure-3", controls.no_local_optimum),
    ("figure-3", controls.exploration_is_not_the_reason),
    ("figure-2", order.order_changes),
    ("figure-3", harder_bandits.stops_at_the_next_bin),
    ("figure-4", partial(sensitivity.sensitive, loss="hl-gauss", field="learning_rate")),
    ("figure-4", partial(sensitivity.sensitive, loss="hl-gauss", field="eta")),
    ("figure-4", sensitivity.wide_targets),
    ("figure-4", partial(sensitivity.sensitive, loss="hl-gauss", field="n_bins", much=False)),
    ("figure-5", partial(sensitivity.sensitive, loss="hl-one-hot", field="n_bins", much=False)),
    ("figure-5", sensitivity.similar_bins),
    ("figure-5", partial(sensitivity.sensitive, loss="hl-one-hot", field="learning_rate")),
    ("figure-6", partial(sensitivity.sensitive, loss="gaussian", field="learning_rate")),
    ("figure-6", sensitivity.also_sensitive),
    ("figure-7", profiles.robust_to_settings),
    ("figure-7", profiles.higher_fraction),
]
"""Each claim by the name of the figure that it rests on, and what judges it from whatever there is.

A study of your own is one more entry, and stands on the page behind these.
"""


def of_figure(name: str) -> list[Judge]:
    """List the functions that judge the claims that rest on a figure."""
    return [judge for figure, judge in CLAIMS if figure == name]
