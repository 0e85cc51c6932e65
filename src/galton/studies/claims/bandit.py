"""What the paper says of the bandit: noise, dimensions, exploration (§5.2.2, §5.2.3)."""

from collections.abc import Callable

import numpy as np

from galton.analysis.page import Claim
from galton.analysis.statistics import Interval, difference_interval
from galton.losses import LOSSES
from galton.studies.base import Data
from galton.studies.claims.verdicts import UNKNOWN, decided, listed, sorted_out, verdict
from galton.studies.figure_3 import CONTROLS, across, losses_in
from galton.studies.measures import CLASSIFICATION, final_return, mean_return


def less_sensitive_to_noise(data: Data) -> Claim:
    """§5.2.2, Figure 3a."""
    bandits = across(data.sweeps, "noise_std", 1.0)
    gaps: dict[str, Interval] = {}
    if len(bandits) > 1:
        calm, noisy = bandits[min(bandits)], bandits[max(bandits)]
        drops = {loss: final_return(calm, loss) - final_return(noisy, loss) for loss in losses_in(bandits)}
        gaps = {
            LOSSES[loss].label: difference_interval(drops["gaussian"], drops[loss])
            for loss in CLASSIFICATION
            if loss in drops
        }
    return Claim(
        "§5.2.2",
        "Classification is less sensitive to noise in the reward.",
        f"bandit, what a noise of {max(bandits, default=0):g} costs in final return: Gaussian's loss − theirs",
        listed(gaps),
        verdict(gaps.values()),
        sorted_out(gaps),
        "figure-3",
    )


def degrades_with_dimension(data: Data) -> Claim:
    """§5.2.2, Figure 3b."""
    bandits = across(data.sweeps, "d", 2.0)
    gaps: dict[str, Interval] = {}
    if len(bandits) > 1:
        few, many = bandits[min(bandits)], bandits[max(bandits)]
        gaps = {
            LOSSES[loss].label: difference_interval(final_return(few, loss), final_return(many, loss))
            for loss in losses_in(bandits)
            if LOSSES[loss].in_paper
        }
    return Claim(
        "§5.2.2",
        "All methods degrade as actions get more dimensions.",
        f"bandit, final return: d = {min(bandits, default=0)} − d = {max(bandits, default=0)}",
        listed(gaps),
        verdict(gaps.values()),
        "A positive number is what the dimensions cost.",
        "figure-3",
    )


def higher_in_all_dimensions(data: Data) -> Claim:
    """§5.2.2, Figure 3b."""
    gaps = {}
    for d, bandit in across(data.sweeps, "d", 2.0).items():
        scores = [final_return(bandit, loss) for loss in CLASSIFICATION if loss in bandit.best]
        worse = min(scores, key=lambda score: float(score.mean()))
        gaps[f"d = {d:g}"] = difference_interval(worse, final_return(bandit, "gaussian"))
    return Claim(
        "§5.2.2",
        "Classification keeps a higher final return than the Gaussian at every dimensionality.",
        "bandit, final return: the worse of HL-1-Hot and HL-Gauss − Gaussian",
        listed(gaps),
        verdict(gaps.values()),
        sorted_out(gaps),
        "figure-3",
    )


def _control(data: Data, name: str, of: Callable[..., np.ndarray]) -> dict[str, Interval]:
    if name not in data.sweeps or "bandit" not in data.sweeps:
        return {}
    control, main = data.sweeps[name], data.sweeps["bandit"]
    return {LOSSES[loss].label: difference_interval(of(control, loss), of(main, loss)) for loss in CLASSIFICATION}


def init_gaussian(data: Data) -> Claim:
    """§5.2.3, Figure 3c."""
    gaps = _control(data, "bandit-init-gaussian", final_return)
    worse = [name for name, gap in gaps.items() if gap.high < 0]
    held = "holds" if not worse else "does not hold" if len(worse) == len(gaps) else "holds in part"
    return Claim(
        "§5.2.3",
        "A Gaussian initial policy has no significant negative effect on classification.",
        "bandit, final return of the best setting: Init Gaussian − uniform",
        listed(gaps),
        held if decided(gaps) else UNKNOWN,
        sorted_out(gaps),
        "figure-3",
    )


def gaussian_exploration(data: Data) -> Claim:
    """§5.2.3, Figure 3d."""
    gaps = _control(data, "bandit-gaussian-exploration", mean_return)
    return Claim(
        "§5.2.3",
        f"{CONTROLS['bandit-gaussian-exploration']} makes both classification losses converge faster.",
        "bandit, training return averaged over training: Gaussian Exploration − sampling from the softmax",
        listed(gaps),
        verdict(gaps.values()),
        sorted_out(gaps),
        "figure-3",
    )


def no_local_optimum(data: Data) -> Claim:
    """§5.2.3, Figure 3d."""
    gaps = _control(data, "bandit-gaussian-exploration", final_return)
    gaps = {name: gap for name, gap in gaps.items() if name == LOSSES["hl-one-hot"].label}
    return Claim(
        "§5.2.3",
        "Gaussian Exploration removes HL-1-Hot's sub-optimal convergence.",
        "bandit, final return of HL-1-Hot: Gaussian Exploration − sampling from the softmax",
        listed(gaps),
        verdict(gaps.values()),
        sorted_out(gaps),
        "figure-3",
    )
