"""Figures 2, 8 and 9: returns on the seven tasks, and what the paper says of them (abstract, §1, §5.2.1, §7)."""

import dataclasses
import functools
import math
from collections.abc import Callable, Iterable, Mapping

import numpy as np

from galton.analysis.statistics import Interval, difference_interval, mean_interval
from galton.losses import LOSSES
from galton.page.page import Claim, Table
from galton.paper.curves import AXES, BANDS, best_curves, shown
from galton.paper.figure import FigureStudy
from galton.paper.measures import (
    CLASSIFICATION,
    Scores,
    better,
    final_return,
    mean_return,
    optimum,
    over_regression,
    progress,
)
from galton.paper.summary import Summary
from galton.paper.sweeps import AGAIN, MAIN
from galton.paper.trained import Judged, Trained
from galton.paper.verdicts import A_TENTH, NOT_TRAINED, UNKNOWN, claim, decided, named
from galton.tasks import TASKS

_ONE_HOT = 0.1
"""η up to which HL-Gauss is HL-1-Hot: the own bin has 0.999999 of the mass or more."""
_IN_THE_APPENDIX = ("lqr", "acrobot")
"""The tasks of Figure 9, which the paper shows in its appendix."""


def winners(trained: Trained) -> Table:
    """The table of each loss's best setting on each task, with its returns as it won and on fresh seeds."""
    headings = ["task", "loss", "best setting", "as it won", "on fresh seeds", "evaluation", "over training"]
    headings += ["noise costs", "doing nothing", "optimum"]
    rows = []
    for task, summary in trained.grids.items():
        again = trained.judged[task].again if task in trained.judged else None
        known = ["—" if value is None else _shown(value) for value in (TASKS[task].at_rest, optimum(task))]
        for loss, best in summary.best.items():
            scores = [_shown(mean_interval(final_return(each, loss))) if each else "—" for each in (summary, again)]
            scores += [_shown(mean_interval(returns)) for returns in _over_training(again or summary, loss)]
            rows.append([TASKS[task].title, LOSSES[loss].label, best.setting.brief(), *scores, *known])
    return Table(headings, rows)


def _over_training(summary: Summary, loss: str) -> tuple[Scores, Scores, Scores]:
    """The deterministic policy's final return, the mean training return, and what noise costs there."""
    over_training = mean_return(summary, loss)
    noise = mean_return(summary, loss, "evaluation_return") - over_training
    return final_return(summary, loss, "evaluation_return"), over_training, noise


def _shown(value: Interval | float) -> str:
    return f"{value:.2f}" if isinstance(value, Interval) else f"{value:.2f}".replace("-", "−")


def _of_most(trained: Trained) -> dict[str, Judged]:
    """The tasks that are done, but for Acrobot, the paper's exception."""
    return {name: task for name, task in trained.judged.items() if name != "acrobot"}


def _against_regression(tasks: Mapping[str, Judged], score: Callable[..., Scores]) -> dict[str, Interval]:
    """What the better classification loss gains over the Gaussian, by the task's title."""
    return {TASKS[name].title: over_regression(task, score) for name, task in tasks.items()}


def _idle(tasks: Mapping[str, Judged]) -> str:
    """A sentence on which of the paper's losses do not clearly learn to do better than nothing."""
    found = []
    for name, task in tasks.items():
        rest = TASKS[name].at_rest
        finals = {loss: mean_interval(final_return(task.again, loss)) for loss in ("gaussian", *CLASSIFICATION)}
        idle = [LOSSES[loss].label for loss, final in finals.items() if rest is not None and final.low <= rest]
        if idle:
            found.append(f"{TASKS[name].title} ({', '.join(idle)})")
    return f"Not clearly above what doing nothing earns: {', '.join(found)}." if found else ""


def _without_noise(tasks: Mapping[str, Judged], score: Callable[..., Scores]) -> str:
    """A sentence with the same verdicts for the deterministic policy, which does not pay for exploration."""
    gaps = _against_regression(tasks, functools.partial(score, metric="evaluation_return"))
    return f"By the deterministic policy's return (Figure 8), {named(gaps)}." if gaps else ""


def _entropies(tasks: Mapping[str, Judged], gaps: Mapping[str, Interval]) -> str:
    """A sentence on how much the better softmax still explores in the end, where it is the worse policy."""
    ends = []
    for name, task in tasks.items():
        if gaps[TASKS[name].title].high < 0:
            setting = task.again.best[better(task.chosen, final_return)].setting
            entropy = mean_interval(task.again.final("entropy")[task.again.rows(setting)]).mean
            uniform = TASKS[name].d * math.log(setting.config.n_bins)
            ends.append(f"{TASKS[name].title} {entropy:.1f} of {uniform:.1f} nats")
    return f"The softmax's final entropy where it ends lower: {', '.join(ends)}." if ends else ""


def ends_higher(trained: Trained) -> Claim:
    """The main result, §5.2.1: with what return training ends."""
    tasks = _of_most(trained)
    gaps = _against_regression(tasks, final_return)
    return claim(
        "§1, §5.2.1",
        "In almost all instances classification reaches a higher return at the end of training. (Acrobot is an "
        "exception.)",
        "final training return on fresh seeds, the classification loss that was better on the grid − Gaussian",
        gaps,
        _without_noise(tasks, final_return),
        _entropies(tasks, gaps),
        _idle(tasks),
    )


def learns_faster(trained: Trained) -> Claim:
    """Data efficiency, §5.2.1: the mean return over all of training."""
    tasks = _of_most(trained)
    return claim(
        "Abstract, §5.2.1",
        "In almost all instances classification learns faster. (Acrobot is an exception.)",
        "training return averaged over all of training, on fresh seeds, the classification loss that was better on "
        "the grid − Gaussian",
        _against_regression(tasks, mean_return),
        _without_noise(tasks, mean_return),
    )


def acrobot(trained: Trained) -> Claim:
    """The exception of §5.2.1, where regression is said to be better."""
    tasks = {name: task for name, task in trained.judged.items() if name == "acrobot"}
    gains = _against_regression(tasks, final_return)
    return claim(
        "§5.2.1",
        "On Acrobot regression outperforms classification.",
        "final training return on fresh seeds, Gaussian − the classification loss that was better on the grid",
        {name: Interval(-gain.mean, -gain.high, -gain.low) for name, gain in gains.items()},
        _entropies(tasks, gains),
        _idle(tasks),
    )


def more_stable(trained: Trained) -> Claim:
    """The fourth contribution of §1: how far seeds end from one another."""
    gaps = {}
    for name, task in trained.judged.items():
        losses = "gaussian", better(task.chosen, final_return)
        scores = [final_return(task.again, loss) for loss in losses]
        gaps[TASKS[name].title] = difference_interval(*(np.abs(score - np.median(score)) for score in scores))
    return claim(
        "§1",
        "Classification learns more stably.",
        "how far seeds end from their median, in training return: Gaussian − the classification loss that was better "
        "on the grid (Brown and Forsythe's comparison of spreads)",
        gaps,
    )


def order_changes(trained: Trained) -> Claim:
    """What §7 says of the two classification losses against each other."""
    gaps, one_hot = {}, []
    for name, task in trained.judged.items():
        start, end = progress(task.chosen)
        gap = difference_interval(*(final_return(task.again, loss) for loss in ("hl-gauss", "hl-one-hot")))
        if end > start:
            gaps[TASKS[name].title] = Interval(*(bound / (end - start) for bound in gap))
        if task.again.best["hl-gauss"].setting.hypers.eta <= _ONE_HOT:
            one_hot.append(TASKS[name].title)
    known = decided(gaps)
    little = [name for name, gap in known.items() if gap.low > -A_TENTH and gap.high < A_TENTH]
    gauss_ahead = [name for name, gap in known.items() if gap.low > 0]
    one_hot_ahead = [name for name, gap in known.items() if gap.high < 0]
    facts = [2 * len(little) >= len(known), bool(gauss_ahead and one_hot_ahead)]
    same = [name for name in one_hot if name in known]
    why = f"Little: {_names(little)}.\nHL-Gauss ahead: {_names(gauss_ahead)}.\nHL-1-Hot ahead: {_names(one_hot_ahead)}."
    why += f"\nOn {_names(same)} the best η is at most {_ONE_HOT}, which is HL-1-Hot." if same else ""
    held = "holds" if all(facts) else "holds in part" if any(facts) else "does not hold"
    told = claim(
        "§7",
        "HL-1-Hot and HL-Gauss often differ little, and which is better changes across tasks.",
        "final training return on fresh seeds, HL-Gauss − HL-1-Hot, as a share of what training gains; often is on "
        "half of the tasks, little within a tenth",
        gaps,
    )
    return dataclasses.replace(told, verdict=held if len(known) > 1 else UNKNOWN, why=why if gaps else NOT_TRAINED)


def _names(tasks: Iterable[str]) -> str:
    return ", ".join(tasks) or "nowhere"


TRAINING = FigureStudy(
    "Training return",
    "Undiscounted training return of each loss's best setting (highest mean final training return on the grid) on "
    f"fresh seeds, which did not choose it and by which claims are judged: mean of n runs, and {BANDS}. Dashed: the "
    "best that any policy can do, where that is known. Dotted: what the action 0 earns, always taken. Long dashes: the "
    f"return from which the task counts as solved. {AXES} In the table the mean of a curve is how a loss does over "
    "training, and the noise of exploration costs what the deterministic policy earns more over training.",
    lambda trained: best_curves(shown(trained), "training_return"),
    (*MAIN.values(), *AGAIN.values()),
    number=2,
    table=winners,
    claims={1: ends_higher, 2: learns_faster, 4: more_stable, 16: order_changes},
)

EVALUATION = FigureStudy(
    "Evaluation return",
    "Undiscounted return of the deterministic policy (the Gaussian's mean, the softmax's most likely bin) during "
    "training, without the noise of exploration: settings, seeds and bands of Figure 2. Thin and dotted, where that "
    "was measured: the softmax policies by the mean of their distribution, since of a wide one the most likely bin is "
    f"nearly any. {AXES}",
    lambda trained: best_curves(shown(trained), "evaluation_return"),
    (*MAIN.values(), *AGAIN.values()),
    number=8,
)

IN_THE_APPENDIX = FigureStudy(
    "Training return on the LQR and on Acrobot",
    "Two panels of Figure 2 again, the same curves, as the paper has them in its appendix.",
    lambda trained: best_curves(
        {task: summary for task, summary in shown(trained).items() if task in _IN_THE_APPENDIX}, "training_return"
    ),
    (*(MAIN[task] for task in _IN_THE_APPENDIX), *(AGAIN[task] for task in _IN_THE_APPENDIX)),
    number=9,
    claims={3: acrobot},
)
