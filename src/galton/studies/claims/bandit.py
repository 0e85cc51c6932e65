"""What the paper says of the bandit: noise, dimensions, exploration (§5.2.2, §5.2.3)."""

from collections.abc import Callable

from galton.analysis.page import Claim
from galton.analysis.statistics import Interval, difference_interval, mean_interval
from galton.losses import LOSSES
from galton.studies.base import Data, optimum
from galton.studies.claims.verdicts import UNKNOWN, decided, listed, sorted_out, verdict
from galton.studies.figure_3 import across, losses_in
from galton.studies.measures import CLASSIFICATION, Scores, final_return, mean_return
from galton.studies.summary import Summary
from galton.studies.sweeps import CONTROLS


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
        f"bandit, final return: d = {min(bandits, default=0):g} − d = {max(bandits, default=0):g}",
        listed(gaps),
        verdict(gaps.values()),
        sorted_out(gaps),
        "figure-3",
    )


def higher_in_all_dimensions(data: Data) -> Claim:
    """§5.2.2, Figure 3b."""
    bandits = across(data.sweeps, "d", 2.0)
    gaps = {
        f"{LOSSES[loss].label} d = {d:g}": difference_interval(
            final_return(bandit, loss), final_return(bandit, "gaussian")
        )
        for loss in CLASSIFICATION
        for d, bandit in bandits.items()
        if len(bandits) > 1 and loss in losses_in(bandits)
    }
    return Claim(
        "§5.2.2",
        "Both classification losses keep a higher final return than the Gaussian at every dimensionality.",
        "bandit, final return − Gaussian's",
        listed(gaps),
        verdict(gaps.values()),
        sorted_out(gaps),
        "figure-3",
    )


def _control(data: Data, name: str) -> tuple[Summary, Summary] | None:
    """The winners under a control and without it, both on fresh seeds."""
    control, main = (data.sweeps.get(f"{sweep}-again") for sweep in (name, "bandit"))
    return (control, main) if control and main else None


def _with_less_without(data: Data, name: str, score: Callable[[Summary, str], Scores]) -> dict[str, Interval]:
    """What a control adds to a score, by loss."""
    pair = _control(data, name)
    if pair is None:
        return {}
    return {LOSSES[loss].label: difference_interval(*(score(each, loss) for each in pair)) for loss in CLASSIFICATION}


def init_gaussian(data: Data) -> Claim:
    """§5.2.3, Figure 3c."""
    gaps = {
        f"{label} {when}": gap
        for when, score in (("final", final_return), ("over training", mean_return))
        for label, gap in _with_less_without(data, "bandit-init-gaussian", score).items()
    }
    known = decided(gaps)
    worse = [name for name, gap in known.items() if gap.high < 0]
    held = "holds" if not worse else "does not hold" if len(worse) == len(known) else "holds in part"
    return Claim(
        "§5.2.3",
        "A Gaussian initial policy has no significant negative effect on classification.",
        "bandit, training return of the best settings, final and averaged over training: Init Gaussian − uniform; "
        "holds if none is clearly negative",
        listed(gaps),
        held if known else UNKNOWN,
        sorted_out(gaps) if not known else f"Clearly negative: {', '.join(worse) or 'none'}.",
        "figure-3",
    )


def gaussian_exploration(data: Data) -> Claim:
    """§5.2.3, Figure 3d."""
    gaps = _with_less_without(data, "bandit-gaussian-exploration", mean_return)
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
    pair, best = _control(data, "bandit-gaussian-exploration"), optimum("bandit")
    gaps: dict[str, Interval] = {}
    held, note = UNKNOWN, ""
    if pair is not None and best is not None:
        left, missing = (best - final_return(summary, "hl-one-hot") for summary in pair)
        gaps = {LOSSES["hl-one-hot"].label: difference_interval(missing, left)}
        held = verdict(gaps.values())
        if held == "holds" and mean_interval(left).high > missing.mean() / 2:
            held = "holds in part"
        note = f"Short of the optimum: {mean_interval(missing):.2f} without, {mean_interval(left):.2f} with it."
    return Claim(
        "§5.2.3",
        "Gaussian Exploration removes HL-1-Hot's sub-optimal convergence.",
        "bandit, by how much less the final training return falls short of the optimum with it; holds in part while "
        "half of that may be left",
        listed(gaps),
        held,
        sorted_out(gaps, note),
        "figure-3",
    )


def exploration_is_not_the_reason(data: Data) -> Claim:
    """§5.2.3, what both controls are for."""
    main = data.sweeps.get("bandit-again")
    gains = {} if main is None else {loss: _more_efficient(main, loss, main) for loss in CLASSIFICATION}
    gaps = {
        f"{LOSSES[loss].label} with {label}": _more_efficient(pair[0], loss, pair[1])
        for name, label in CONTROLS.items()
        if (pair := _control(data, name))
        for loss, gain in gains.items()
        if gain.low > 0
    }
    no_gain = ", ".join(f"{LOSSES[loss].label} {gain:+.2f}" for loss, gain in gains.items() if not gain.low > 0)
    notes = [f"Not clearly more efficient to begin with: {no_gain}."] if no_gain else []
    return Claim(
        "§5.2.3",
        "Softmax exploration is not the key reason for the higher data efficiency.",
        "bandit, training return averaged over training: classification that starts or explores as the Gaussian does "
        "− Gaussian, of the losses that are ahead of it without that",
        listed(gaps),
        verdict(gaps.values()),
        sorted_out(gaps, *notes) if gaps or not notes else notes[0],
        "figure-3",
    )


def _more_efficient(summary: Summary, loss: str, main: Summary) -> Interval:
    return difference_interval(mean_return(summary, loss), mean_return(main, "gaussian"))
