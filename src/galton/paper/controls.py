"""The two controls of §5.2.3, on the bandit: softmax policies that start, or explore, as the Gaussian does."""

import dataclasses
from collections.abc import Callable
from typing import NamedTuple

from galton.analysis.statistics import Interval, difference_interval, mean_interval
from galton.losses import LOSSES
from galton.page.page import Claim
from galton.paper.measures import CLASSIFICATION, Scores, final_return, mean_return, optimum
from galton.paper.summary import Summary
from galton.paper.sweeps import AGAIN, Budget, Done, Sweep, again, main_settings, task_study
from galton.paper.trained import Trained
from galton.paper.verdicts import UNKNOWN, claim, decided
from galton.sweep.study import Study
from galton.types import Config


class Control(NamedTuple):
    """The bandit's sweep again, with the softmax policies under one of §5.2.3's two conditions."""

    label: str
    sweep: Sweep
    again: Sweep


def _control(name: str, label: str, change: Callable[[Config], Config]) -> Control:
    def study(budget: Budget, _: Done) -> Study:
        changed = (
            setting._replace(config=change(setting.config))
            for setting in main_settings("bandit", budget)
            if setting.config.loss != "gaussian"
        )
        return task_study("bandit", budget, tuple(changed))

    sweep = Sweep(name, study)
    return Control(label, sweep, again(sweep))


INIT_GAUSSIAN = _control(
    "bandit-init-gaussian", "Init Gaussian", lambda config: dataclasses.replace(config, initial_policy="gaussian")
)
EXPLORATION = _control(
    "bandit-gaussian-exploration",
    "Gaussian Exploration",
    lambda config: dataclasses.replace(config, exploration="gaussian"),
)
CONTROLS = (INIT_GAUSSIAN, EXPLORATION)


def _pair(trained: Trained, control: Control) -> tuple[Summary, Summary] | None:
    """The winners under a control and without it, both on fresh seeds."""
    under, main = trained.of(control.again), trained.of(AGAIN["bandit"])
    return (under, main) if under and main else None


def _gains(trained: Trained, control: Control, score: Callable[[Summary, str], Scores]) -> dict[str, Interval]:
    """What a control adds to a score, by the loss's label; nothing where it was not trained."""
    pair = _pair(trained, control)
    if pair is None:
        return {}
    return {LOSSES[loss].label: difference_interval(*(score(each, loss) for each in pair)) for loss in CLASSIFICATION}


def starts_as_well(trained: Trained) -> Claim:
    """What §5.2.3 says of Figure 3c: Init Gaussian does no harm."""
    gaps = {
        f"{label} {when}": gap
        for when, score in (("final", final_return), ("over training", mean_return))
        for label, gap in _gains(trained, INIT_GAUSSIAN, score).items()
    }
    told = claim(
        "§5.2.3",
        "A Gaussian initial policy has no significant negative effect on classification.",
        "bandit, training return of the best settings, final and averaged over training: Init Gaussian − uniform; "
        "holds if none is clearly negative",
        gaps,
    )
    known = decided(gaps)
    if not known:
        return dataclasses.replace(told, verdict=UNKNOWN)
    worse = [name for name, gap in known.items() if gap.high < 0]
    held = "holds" if not worse else "does not hold" if len(worse) == len(known) else "holds in part"
    return dataclasses.replace(told, verdict=held, why=f"Clearly negative: {', '.join(worse) or 'none'}.")


def converges_faster(trained: Trained) -> Claim:
    """What §5.2.3 says of Figure 3d: Gaussian Exploration is faster."""
    return claim(
        "§5.2.3",
        "Gaussian Exploration makes both classification losses converge faster.",
        "bandit, training return averaged over training: Gaussian Exploration − sampling from the softmax",
        _gains(trained, EXPLORATION, mean_return),
    )


def no_local_optimum(trained: Trained) -> Claim:
    """What §5.2.3 says of Figure 3d: HL-1-Hot no longer stops short of the optimum."""
    pair, best = _pair(trained, EXPLORATION), optimum("bandit")
    gaps: dict[str, Interval] = {}
    half_is_left, note = False, ""
    if pair is not None and best is not None:
        left, missing = (best - final_return(summary, "hl-one-hot") for summary in pair)
        gaps = {LOSSES["hl-one-hot"].label: difference_interval(missing, left)}
        half_is_left = bool(mean_interval(left).high > missing.mean() / 2)
        note = f"Short of the optimum: {mean_interval(missing):.2f} without, {mean_interval(left):.2f} with it."
    told = claim(
        "§5.2.3",
        "Gaussian Exploration removes HL-1-Hot's sub-optimal convergence.",
        "bandit, by how much less the final training return falls short of the optimum with it; holds in part while "
        "half of that may be left",
        gaps,
        note,
    )
    held = "holds in part" if half_is_left and told.verdict == "holds" else told.verdict
    return dataclasses.replace(told, verdict=held)


def exploration_is_not_the_reason(trained: Trained) -> Claim:
    """What both controls are for, §5.2.3: whether classification is ahead without its own exploration."""
    main = trained.of(AGAIN["bandit"])
    gains = {} if main is None else {loss: _more_efficient(main, loss, main) for loss in CLASSIFICATION}
    gaps = {
        f"{LOSSES[loss].label} with {control.label}": _more_efficient(pair[0], loss, pair[1])
        for control in CONTROLS
        if (pair := _pair(trained, control))
        for loss, gain in gains.items()
        if gain.low > 0
    }
    no_gain = ", ".join(f"{LOSSES[loss].label} {gain:+.2f}" for loss, gain in gains.items() if not gain.low > 0)
    note = f"Not clearly more efficient to begin with: {no_gain}." if no_gain else ""
    told = claim(
        "§5.2.3",
        "Softmax exploration is not the key reason for the higher data efficiency.",
        "bandit, training return averaged over training: classification that starts or explores as the Gaussian does "
        "− Gaussian, of the losses that are ahead of it without that",
        gaps,
        note,
    )
    return dataclasses.replace(told, why=told.why if gaps or not note else note)


def _more_efficient(summary: Summary, loss: str, main: Summary) -> Interval:
    return difference_interval(mean_return(summary, loss), mean_return(main, "gaussian"))
