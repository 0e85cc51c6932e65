"""The two controls of §5.2.3, on the bandit: softmax policies that start, or explore, as the Gaussian does."""

import dataclasses
from collections.abc import Iterator, Mapping
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Float

from galton.losses import LOSSES
from galton_experiments.analysis import Comparison, compare, decide, mean_interval
from galton_experiments.page import Claim
from galton_experiments.runs import Summary
from galton_experiments.sweep import Setting
from studies.paper.measures import CLASSIFICATION, DETERMINISTIC, Score, final_return, mean_return, over_training
from studies.paper.prose import says
from studies.paper.sweeps import AGAIN, MAIN, Budget, Sweep, again, grid, main_settings
from studies.paper.trained import Trained, optimum
from studies.paper.verdicts import claim, told

Means = Float[np.ndarray, " settings"]


class Control(NamedTuple):
    """The bandit's sweep again, with the softmax policies under one of §5.2.3's two conditions."""

    label: str
    sweep: Sweep
    again: Sweep
    change: dict[str, Any]
    """The settings of a softmax policy under it."""


def _control(name: str, label: str, **change: str) -> Control:
    def settings(budget: Budget) -> Iterator[Setting]:
        softmaxes = (setting for setting in main_settings("bandit", budget) if setting["loss"] != "gaussian")
        return (setting.replace(**change) for setting in softmaxes)

    sweep = grid(name, "bandit", settings)
    return Control(label, sweep, again(sweep), change)


INIT_GAUSSIAN = _control("bandit-init-gaussian", "Init Gaussian", initial_policy="gaussian")
EXPLORATION = _control("bandit-gaussian-exploration", "Gaussian Exploration", exploration="gaussian")
CONTROLS = (INIT_GAUSSIAN, EXPLORATION)


def _pair(trained: Trained, control: Control) -> tuple[Summary, Summary] | None:
    """The winners under a control and without it, both on fresh seeds."""
    under, main = trained.of(control.again), trained.of(AGAIN["bandit"])
    return (under, main) if under and main else None


def _gains(trained: Trained, control: Control, score: Score) -> dict[str, Comparison]:
    """Return what a control adds to the winners' score, by the loss's label; nothing where it was not trained."""
    pair = _pair(trained, control)
    if pair is None:
        return {}
    under, main = pair
    paired = under.is_paired_with(main)
    return {LOSSES[loss].label: compare(score(under, loss), score(main, loss), paired) for loss in CLASSIFICATION}


def _at_equal_settings(trained: Trained, control: Control) -> dict[str, tuple[Means, Means]]:
    """The mean over training and trials of every setting of the grid under a control, and without it, by loss."""
    under, main = trained.of(control.sweep), trained.of(MAIN["bandit"])
    found: dict[str, tuple[Means, Means]] = {}
    if under is None or main is None:
        return found
    changed, plain = over_training(under), over_training(main)
    for loss in CLASSIFICATION:
        own = [setting for setting in plain if setting["loss"] == loss]
        twins = [(setting.replace(**control.change), setting) for setting in own]
        pairs = [(changed[one], plain[other]) for one, other in twins if one in changed]
        if pairs:
            found[loss] = (np.array([one for one, _ in pairs]), np.array([other for _, other in pairs]))
    return found


def _counted(equal: Mapping[str, tuple[Means, Means]], sign: int) -> str:
    """In how many settings each loss is higher under a control, or lower."""
    found = (f"{LOSSES[x].label} in {(sign * (one - two) > 0).sum()} of {len(one)}" for x, (one, two) in equal.items())
    return ", ".join(found)


def starts_as_well(trained: Trained) -> Claim:
    """Judge what §5.2.3 says of Figure 3c: Init Gaussian does no harm."""
    lower = _counted(_at_equal_settings(trained, INIT_GAUSSIAN), -1)
    return claim(
        *says("starts_as_well"),
        {
            f"{label} {when}": gain
            for when, score in (("final", final_return), ("over training", mean_return))
            for label, gain in _gains(trained, INIT_GAUSSIAN, score).items()
        },
        f"At equal settings of the grid its mean over training is lower: {lower}." if lower else "",
        unless_contrary=True,
    )


def converges_faster(trained: Trained) -> Claim:
    """Judge what §5.2.3 says of Figure 3d: Gaussian Exploration is faster."""
    equal = _at_equal_settings(trained, EXPLORATION)
    counts, winners = _counted(equal, 1), _gains(trained, EXPLORATION, mean_return)
    gains = ", ".join(f"{label} {told(gain)}" for label, gain in winners.items())
    return claim(
        *says("converges_faster"),
        {LOSSES[loss].label: compare(*pair, paired=True) for loss, pair in equal.items()},
        f"Higher with it: {counts}." if counts else "",
        f"The best settings of each, which are not the same, on fresh seeds: {gains}." if gains else "",
    )


def no_local_optimum(trained: Trained) -> Claim:
    """Judge what §5.2.3 says of Figure 3d: HL-1-Hot no longer stops short of the optimum."""
    pair, best = _pair(trained, EXPLORATION), optimum("bandit")
    units, note = {}, ""
    if pair is not None and best is not None:
        left, missing = (best - final_return(summary, "hl-one-hot") for summary in pair)
        paired = pair[0].is_paired_with(pair[1])
        parts = {"less is missing": missing, "less than half is": missing / 2}
        units = {name: compare(part, left, paired) for name, part in parts.items()}
        note = f"Short of the optimum: {mean_interval(missing):.2f} without, {mean_interval(left):.2f} with it."
    return claim(*says("no_local_optimum"), units, note)


def exploration_is_not_the_reason(trained: Trained) -> Claim:
    """Judge by both controls (§5.2.3) whether classification is ahead without its own exploration."""
    main = trained.of(AGAIN["bandit"])
    gains: dict[tuple[str, str], Comparison] = {}
    for metric in {"training_return": "", **DETERMINISTIC}:
        if main is not None and metric in main.table.column_names:
            gains |= {(loss, metric): _over_gaussian(main, loss, main, metric) for loss in CLASSIFICATION}
    ahead = [key for key, decision in decide(gains).items() if decision.mark == "✓"]
    units = {
        f"{_named(loss, metric)}, {control.label}": _over_gaussian(pair[0], loss, pair[1], metric)
        for control in CONTROLS
        if (pair := _pair(trained, control))
        for loss, metric in ahead
        if metric in pair[0].table.column_names
    }
    no_gain = ", ".join(f"{_named(*key)} {told(gain)}" for key, gain in gains.items() if key not in ahead)
    note = f"Not clearly more efficient to begin with: {no_gain}." if no_gain else ""
    judged = claim(*says("exploration_is_not_the_reason"), units, note)
    return judged if units or not note else dataclasses.replace(judged, why=note)


def _named(loss: str, metric: str) -> str:
    return f"{LOSSES[loss].label} ({DETERMINISTIC.get(metric, 'training return')})"


def _over_gaussian(summary: Summary, loss: str, main: Summary, metric: str) -> Comparison:
    ours, theirs = mean_return(summary, loss, metric), mean_return(main, "gaussian", metric)
    return compare(ours, theirs, summary.is_paired_with(main))
