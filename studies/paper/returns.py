"""Figures 2, 8 and 9: returns on the seven tasks, and what the paper says of them (abstract, §1, §5.2.1)."""

import math
from collections.abc import Callable, Iterable, Mapping

import numpy as np
from matplotlib.figure import Figure

from galton.losses import LOSSES
from galton.tasks import TASKS
from galton_experiments.analysis import Comparison, compare, mean_interval
from galton_experiments.page import Claim
from studies.paper import measures
from studies.paper.curves import best_curves, shown
from studies.paper.figure import figure
from studies.paper.measures import better, better_by, final_return, logged, mean_return, over_regression
from studies.paper.prose import says
from studies.paper.standings import winners
from studies.paper.sweeps import AGAIN, MAIN
from studies.paper.trained import Judged, Scale, Trained, rest
from studies.paper.verdicts import Found, Unit, by_task, claim, marks, summed_up, unit

_A_QUARTER = 0.25
"""The share of the way from rest to the best that is called having learned something."""
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


def _gap(measure: Callable[..., measures.Scores]) -> Callable[[Judged, Scale, str], Comparison]:
    """Return a function that compares the better classification loss with the Gaussian."""
    return lambda task, _, metric: over_regression(task, measure, metric)


_end, _mean = _gap(final_return), _gap(mean_return)


def _steps(task: Judged, scale: Scale, metric: str) -> Unit:
    """Measure how much sooner the classification loss, chosen by its mean over training, goes a quarter of the way.

    By the order of all runs, without pairs: of one that never gets there it is not known by how much it is later.
    """
    ours, level, last = better_by(task.chosen, mean_return, metric), scale.at(_A_QUARTER), task.again.steps[-1]
    theirs, its = (measures.steps_to(task.again, loss, level, metric) for loss in ("gaussian", ours))
    found, medians = compare(theirs, its), (float(np.median(steps)) for steps in (theirs, its))
    shown = (f"{steps:,.0f}" if steps <= last else "never" for steps in medians)
    return unit(found, f"{' and '.join(shown)}, P = {found.above:.2f}")


def _idle(trained: Trained, tasks: Iterable[str]) -> str:
    """A sentence on which of the paper's losses do not clearly learn to do better than rest."""
    found = []
    for name in tasks:
        level = rest(name)
        if name in trained.scales and level is not None:
            again = trained.judged[name].again
            finals = {LOSSES[x].label: final_return(again, x) for x in again.best if LOSSES[x].in_paper}
            idle = [label for label, final in finals.items() if not mean_interval(final).low > level]
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
        *says("ends_higher"),
        units,
        *_without_noise(trained, tasks, _end),
        _entropies(trained, units),
        _idle(trained, tasks),
    )


def ends_higher_without_noise(trained: Trained) -> Claim:
    """The main result where nothing is paid for exploration: by the mean action, or else by the most likely one."""

    def end(task: Judged, scale: Scale, _: str) -> Comparison:
        return _end(task, scale, [*logged(task.again)][-1])

    return claim(*says("ends_higher_without_noise"), _units(trained, _of_most(trained), end))


def learns_faster(trained: Trained) -> Claim:
    """Data efficiency, §5.2.1: the mean return over all of training."""
    tasks = _of_most(trained)
    return claim(*says("learns_faster"), _units(trained, tasks, _mean), *_without_noise(trained, tasks, _mean))


def learns_sooner(trained: Trained) -> Claim:
    """Data efficiency, §5.2.1, without level and start: the steps until something is learned."""
    tasks = _of_most(trained)
    return claim(*says("learns_sooner"), _units(trained, tasks, _steps), *_without_noise(trained, tasks, _steps))


def acrobot(trained: Trained) -> Claim:
    """The exception of §5.2.1, where regression is said to be better."""
    tasks = [task for task in trained.judged if task == "acrobot"]

    def behind(task: Judged, scale: Scale, metric: str) -> Comparison:
        return -_end(task, scale, metric)

    return claim(
        *says("acrobot"),
        _units(trained, tasks, behind),
        *_without_noise(trained, tasks, behind),
        _entropies(trained, _units(trained, tasks, _end)),
        _idle(trained, tasks),
    )


def _curves(metric: str, tasks: Iterable[str] = tuple(TASKS)) -> Callable[[Trained], Figure]:
    """Draws the learning curves on these tasks."""
    return lambda trained: best_curves({task: runs for task, runs in shown(trained).items() if task in tasks}, metric)


_SWEEPS = (*MAIN.values(), *AGAIN.values())
TRAINING = figure("figure-2", _curves("training_return"), _SWEEPS, table=winners)
EVALUATION = figure("figure-8", _curves("evaluation_return"), _SWEEPS)
IN_THE_APPENDIX = figure(
    "figure-9",
    _curves("training_return", _IN_THE_APPENDIX),
    tuple(sweep[task] for sweep in (MAIN, AGAIN) for task in _IN_THE_APPENDIX),
)
