"""Figures 2, 8 and 9: returns on the seven tasks, and what the paper says of them (abstract, §1, §5.2.1)."""

import math
from collections.abc import Callable, Iterable, Mapping

import numpy as np

from galton.losses import LOSSES
from galton.tasks import TASKS
from galton_experiments.analysis import AXES, Comparison, compare, mean_interval
from galton_experiments.page import Claim
from studies.paper import order, stability
from studies.paper.curves import BANDS, best_curves, shown
from studies.paper.figure import FigureStudy
from studies.paper.measures import (
    better,
    better_by,
    final_return,
    logged,
    mean_return,
    over_regression,
    steps_to,
)
from studies.paper.scale import Scale, rest
from studies.paper.standings import winners
from studies.paper.sweeps import AGAIN, MAIN
from studies.paper.trained import Judged, Trained
from studies.paper.verdicts import Found, Unit, by_task, claim, marks, summed_up, unit

_A_QUARTER = 0.25
"""How much of the way from rest to the best is called having learned something."""
_IN_THE_APPENDIX = ("lqr", "acrobot")
"""The tasks of Figure 9, which the paper shows in its appendix."""

Judge = Callable[[Judged, Scale, str], Comparison | Unit]
"""Compares the losses of a task, from the way from rest to the best and the metric of the log."""


def _of_most(trained: Trained) -> list[str]:
    """The tasks that are done, but for Acrobot, the paper's exception."""
    return [task for task in trained.judged if task != "acrobot"]


def _units(trained: Trained, tasks: Iterable[str], judge: Judge, metric: str = "training_return") -> dict[str, Found]:
    return by_task(trained, tasks, lambda task, scale: {"": judge(trained.judged[task], scale, metric)})


def _without_noise(trained: Trained, tasks: Iterable[str], judge: Judge) -> list[str]:
    """A sentence for each kind of deterministic policy, which does not pay for exploration, with its verdicts."""
    kinds: dict[tuple[str, str], list[str]] = {}
    for task in tasks:
        if task in trained.scales:
            for kind in logged(trained.judged[task].again).items():
                kinds.setdefault(kind, []).append(task)
    return [
        summed_up(f"By the deterministic policy's return ({name})", _units(trained, those, judge, metric))
        for (metric, name), those in kinds.items()
    ]


def _end(task: Judged, _: Scale, metric: str) -> Comparison:
    return over_regression(task, final_return, metric)


def _mean(task: Judged, _: Scale, metric: str) -> Comparison:
    return over_regression(task, mean_return, metric)


def _steps(task: Judged, scale: Scale, metric: str) -> Unit:
    """How much sooner the classification loss, chosen by its mean over training, has gone a quarter of the way.

    By the order of all runs, without pairs: of one that never gets there it is not known by how much it is later.
    """
    ours, level, last = better_by(task.chosen, mean_return, metric), scale.at(_A_QUARTER), task.again.steps[-1]
    theirs, its = (steps_to(task.again, loss, level, metric) for loss in ("gaussian", ours))
    found, medians = compare(theirs, its), (float(np.median(steps)) for steps in (theirs, its))
    shown = (f"{steps:,.0f}" if steps <= last else "never" for steps in medians)
    return unit(found, f"{' and '.join(shown)}, P = {found.above:.2f}")


def _idle(trained: Trained, tasks: Iterable[str]) -> str:
    """A sentence on which of the paper's losses do not clearly learn to do better than rest."""
    found = []
    for name in tasks:
        if name in trained.scales:
            again = trained.judged[name].again
            finals = {loss: final_return(again, loss) for loss in again.best if LOSSES[loss].in_paper}
            level = rest(name)
            idle = [
                LOSSES[loss].label
                for loss, final in finals.items()
                if level is not None and not mean_interval(final).low > level
            ]
            found += [f"{TASKS[name].title} ({', '.join(idle)})"] if idle else []
    what = "Not clearly above rest, the better of doing nothing and of acting at random"
    return f"{what}: {', '.join(found)}." if found else ""


def _entropies(trained: Trained, units: Mapping[str, Found]) -> str:
    """A sentence on how much the better softmax still explores in the end, where it is clearly the worse policy."""
    worse = [title for title, mark in marks(units).items() if mark == "✗"]
    ends = []
    for name, task in trained.judged.items():
        if TASKS[name].title in worse:
            setting = task.again.best[better(task.chosen, final_return)].setting
            entropy = mean_interval(task.again.final("entropy")[task.again.rows(setting)]).mean
            uniform = TASKS[name].d * math.log(setting["n_bins"])
            ends.append(f"{TASKS[name].title} {entropy:.1f} of {uniform:.1f} nats")
    return f"The softmax's final entropy where it ends lower: {', '.join(ends)}." if ends else ""


def ends_higher(trained: Trained) -> Claim:
    """The main result, §5.2.1: with what return training ends."""
    tasks = _of_most(trained)
    units = _units(trained, tasks, _end)
    return claim(
        "§1, §5.2.1",
        "In almost all instances classification reaches a higher return at the end of training. (Acrobot is an "
        "exception.)",
        "final training return on fresh seeds, the classification loss that was better on the grid − Gaussian",
        units,
        *_without_noise(trained, tasks, _end),
        _entropies(trained, units),
        _idle(trained, tasks),
    )


def ends_higher_without_noise(trained: Trained) -> Claim:
    """The main result where nothing is paid for exploration: by the mean action, or else by the most likely one."""

    def end(task: Judged, scale: Scale, _: str) -> Comparison:
        return _end(task, scale, [*logged(task.again)][-1])

    return claim(
        "§5.2.1",
        "In almost all instances classification's deterministic policy ends higher. (Acrobot is an exception.)",
        "final return of the deterministic policy on fresh seeds (the mean action where it was logged), the "
        "classification loss that was better on the grid − Gaussian",
        _units(trained, _of_most(trained), end),
    )


def learns_faster(trained: Trained) -> Claim:
    """Data efficiency, §5.2.1: the mean return over all of training."""
    tasks = _of_most(trained)
    return claim(
        "Abstract, §5.2.1",
        "In almost all instances classification learns faster: more return over training. (Acrobot is an exception.)",
        "training return averaged over all of training, on fresh seeds, the classification loss that was better on "
        "the grid − Gaussian",
        _units(trained, tasks, _mean),
        *_without_noise(trained, tasks, _mean),
    )


def learns_sooner(trained: Trained) -> Claim:
    """Data efficiency, §5.2.1, without level and start: the steps until something is learned."""
    tasks = _of_most(trained)
    return claim(
        "Abstract, §5.2.1",
        "In almost all instances classification learns faster: fewer steps until something is learned. (Acrobot is an "
        "exception.)",
        "environment steps to the first log point at a quarter of the way from rest to the best, by training return on "
        "fresh seeds: median for the Gaussian and for the classification loss with the higher mean over training on "
        "the grid; P that the Gaussian is later. Seeds are no pairs here; a run that never gets there is one log point "
        "later than the last",
        _units(trained, tasks, _steps),
        *_without_noise(trained, tasks, _steps),
    )


def acrobot(trained: Trained) -> Claim:
    """The exception of §5.2.1, where regression is said to be better."""
    tasks = [task for task in trained.judged if task == "acrobot"]

    def behind(task: Judged, scale: Scale, metric: str) -> Comparison:
        return -_end(task, scale, metric)

    return claim(
        "§5.2.1",
        "On Acrobot regression outperforms classification.",
        "final training return on fresh seeds, Gaussian − the classification loss that was better on the grid",
        _units(trained, tasks, behind),
        *_without_noise(trained, tasks, behind),
        _entropies(trained, _units(trained, tasks, _end)),
        _idle(trained, tasks),
    )


TRAINING = FigureStudy(
    "Training return",
    "Undiscounted training return of each loss's best setting (highest mean final training return on the grid) on "
    "fresh seeds, which did not choose it and by which claims are judged: mean of n runs, a diverged one until it did, "
    f"and {BANDS}. Dashed: the best that any policy can do, where that is known. Dotted: what the action 0 earns, "
    f"always taken. Long dashes: the return from which the task counts as solved. {AXES} In the table the mean of a "
    "curve is how a loss does over training, and the noise of exploration costs what the deterministic policy earns "
    "more over training.",
    lambda trained: best_curves(shown(trained), "training_return"),
    (*MAIN.values(), *AGAIN.values()),
    number=2,
    table=winners,
    claims={
        1: ends_higher,
        2: learns_faster,
        2.5: learns_sooner,
        4: stability.alike_between_seeds,
        4.5: stability.keeps_what_it_learns,
        16: order.order_changes,
    },
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
