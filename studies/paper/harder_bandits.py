"""The bandits of Figure 3, under noise and in more dimensions, and what the paper says of them (§5.2.2, §7)."""

from collections.abc import Mapping

import numpy as np

from galton import Bins
from galton.envs import find
from galton.losses import LOSSES
from galton_experiments.analysis import Comparison, against, compare
from galton_experiments.page import Claim
from galton_experiments.runs import Summary
from studies.paper.measures import CLASSIFICATION, Scores, final_return, versus
from studies.paper.prose import says
from studies.paper.sweeps import AGAIN, MAIN, Sweep, again, winners_for
from studies.paper.trained import Trained, optimum
from studies.paper.verdicts import A_TENTH, Found, claim, unit

_BANDIT, _BANDIT_AGAIN = MAIN["bandit"], AGAIN["bandit"]


def _with(name: str, constant: str, value: float | int) -> Sweep:
    """The sweep of the bandit's winners on a bandit with another constant, on fresh seeds."""
    return again(_BANDIT, winners_for, name=f"bandit-{name}-{value:g}", env_kwargs={constant: value})


NOISE = {value: _with("noise", "noise_std", value) for value in (0.0, 2.0, 5.0, 10.0)} | {1.0: _BANDIT_AGAIN}
"""The bandits of Figure 3a by their reward noise, 1 being the bandit's own; the paper doesn't tell its values."""
DIMENSION = {float(d): _with("d", "d", d) for d in (1, 4, 8, 16)} | {2.0: _BANDIT_AGAIN}
"""The bandits of Figure 3b by their action dimensions, 2 being the bandit's own."""


def across(trained: Trained, bandits: Mapping[float, Sweep]) -> dict[float, Summary]:
    """The bandits that are done, by their constant and in its order."""
    found = {value: trained.sweeps[sweep.name] for value, sweep in bandits.items() if sweep.name in trained.sweeps}
    return dict(sorted(found.items()))


def losses_in(bandits: Mapping[float, Summary]) -> list[str]:
    """The losses that were trained on all of these bandits."""
    first, *others = bandits.values()
    return [loss for loss in first.best if all(loss in bandit.best for bandit in others)]


def _ends(bandits: Mapping[float, Summary]) -> dict[str, str]:
    return {"least": f"{min(bandits, default=0):g}", "most": f"{max(bandits, default=0):g}"}


def _costs(bandits: Mapping[float, Summary]) -> dict[str, Comparison]:
    """Compare the drops from the first of some bandits to the last: the Gaussian's with each classification loss's."""
    if len(bandits) < 2:
        return {}
    first, *_, last = bandits.values()
    drops = {loss: final_return(first, loss) - final_return(last, loss) for loss in losses_in(bandits)}
    return {
        LOSSES[loss].label: compare(drops["gaussian"], drops[loss], first.is_paired_with(last))
        for loss in CLASSIFICATION
        if loss in drops
    }


def _shortfalls(bandits: Mapping[float, Summary], name: str) -> str:
    """A sentence on how far from the optimum each loss ends on the first and the last of some bandits."""
    best = optimum("bandit")
    if best is None or len(bandits) < 2:
        return ""
    (low, first), *_, (high, last) = bandits.items()
    ends = (
        f"{LOSSES[loss].label} {best - final_return(first, loss).mean():.2f} and "
        f"{best - final_return(last, loss).mean():.2f}"
        for loss in losses_in(bandits)
        if LOSSES[loss].in_paper
    )
    return f"Level: short of the optimum at {name} = {low:g} and {high:g}: {', '.join(ends)}."


def less_sensitive_to_noise(trained: Trained) -> Claim:
    """Judge what §5.2.2 says of Figure 3a: noise costs classification less."""
    bandits = across(trained, NOISE)
    return claim(*says("less_sensitive_to_noise", **_ends(bandits)), _costs(bandits), _shortfalls(bandits, "σ"))


def degrades_with_dimension(trained: Trained) -> Claim:
    """Judge what §5.2.2 says of Figure 3b: more dimensions cost every loss something."""
    bandits = across(trained, DIMENSION)
    units: dict[str, Comparison] = {}
    if len(bandits) > 1:
        few, many = bandits[min(bandits)], bandits[max(bandits)]
        units = {
            LOSSES[loss].label: compare(final_return(few, loss), final_return(many, loss), few.is_paired_with(many))
            for loss in losses_in(bandits)
            if LOSSES[loss].in_paper
        }
    return claim(*says("degrades_with_dimension", **_ends(bandits)), units)


def higher_in_all_dimensions(trained: Trained) -> Claim:
    """Judge what §5.2.2 says of Figure 3b: classification stays ahead of the Gaussian."""
    bandits = across(trained, DIMENSION)
    return claim(
        *says("higher_in_all_dimensions"),
        {
            f"{LOSSES[loss].label} d = {d:g}": versus(bandit, loss, "gaussian", final_return)
            for loss in CLASSIFICATION
            for d, bandit in bandits.items()
            if len(bandits) > 1 and loss in losses_in(bandits)
        },
    )


def gap_grows_with_dimension(trained: Trained) -> Claim:
    """Judge what §5.2.2 and §7 make of Figure 3b: the more dimensions, the more classification is ahead."""
    bandits = across(trained, DIMENSION)
    return claim(*says("gap_grows_with_dimension", **_ends(bandits)), _costs(bandits), _shortfalls(bandits, "d"))


def stops_at_the_next_bin(trained: Trained) -> Claim:
    """Judge what §7 says of HL-1-Hot: it may end in the bin beside the optimum's, and that costs little."""
    bandits, best, way = across(trained, NOISE), optimum("bandit"), trained.scales.get("bandit")
    units: dict[str, Found] = {}
    calm = min(bandits, default=0.0)
    if bandits and best is not None and way is not None and {*CLASSIFICATION} <= {*bandits[calm].best}:
        bandit = bandits[calm]

        def short(summary: Summary, loss: str) -> Scores:
            return best - final_return(summary, loss, "evaluation_return")

        one_hot, next_bin = short(bandit, "hl-one-hot"), _cost_of_the_next_bin(bandit)
        near, little = against(one_hot, next_bin), against(way.share(best - one_hot), 1 - A_TENTH)
        shown = f"{one_hot.mean():.2f} (median {np.median(one_hot):.2f})"
        units = {
            "shorter of the optimum than HL-Gauss:": versus(bandit, "hl-one-hot", "hl-gauss", short),
            f"at the next bin at most, which costs {next_bin:.2f}:": unit(-near, shown),
            "by less than a tenth of the way from rest:": unit(little, shown),
        }
    return claim(*says("stops_at_the_next_bin", noise=f"{calm:g}"), units)


def _cost_of_the_next_bin(bandit: Summary) -> float:
    """The most that a bin beside the best one costs: its centre is up to one and a half widths away, squared."""
    actions = find(bandit.study.env).actions
    n_bins = bandit.best["hl-one-hot"].setting["n_bins"]
    return float((1.5 * Bins(actions.low, actions.high, n_bins).width.max()) ** 2)
