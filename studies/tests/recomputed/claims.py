"""The second path, part 3: the claims on tasks (§1, §5.2.1, §7) and on whole grids (§5.1, App. C.3 and C.4)."""

import numpy as np

from .ranks import against, alike, compared, judged, marks_of, mean_of, null
from .runs import CLASSIFIED, LABELS, PAPER, TITLES, Task, ends_of, null_of

KINDS = {"evaluation_return": "most likely action", "mean_action_return": "mean action"}


def by_task(tasks, judge):
    """The decisions of each task, those of null tasks as such."""
    found = []
    for name, task in tasks.items():
        why = null_of(task)
        found += [null(TITLES[name], why)] if why else judge(task, TITLES[name])
    return found


def better(task, score, metric):
    """The classification loss that is better where settings were chosen, which may lack the mean action's return."""
    known = metric if task.grid.has(metric) else "evaluation_return"
    return max(
        (loss for loss in CLASSIFIED if loss in task.grid.losses), key=lambda x: score(task.grid, x, known).mean()
    )


def paired(*runs):
    return runs[0].seed is not None and len({each.seed for each in runs}) == 1


def gap(task, name, score, metric):
    """The better classification loss over the Gaussian."""
    loss, again = better(task, score, metric), task.again
    both = score(again, loss, metric), score(again, "gaussian", metric)
    return compared(name, *both, paired(again.of(loss), again.of("gaussian")))


def final(sweep, loss, metric="training_return"):
    return sweep.final(loss, metric)


def mean(sweep, loss, metric="training_return"):
    return sweep.mean(loss, metric)


def ends(task, name, metric="training_return"):
    return [gap(task, name, final, metric)]


def learns(task, name, metric="training_return"):
    return [gap(task, name, mean, metric)]


def sooner(task, name, metric="training_return"):
    """Steps until a quarter of the way: median of the Gaussian's and theirs, by the order of all runs."""
    (rest, best), loss = ends_of(task), better(task, mean, metric)
    samples, steps = [], task.again.of(loss).steps
    for each in ("gaussian", loss):
        reached = [np.flatnonzero(run >= rest + (best - rest) / 4) for run in task.again.curve(each, metric)]
        never = steps[-1] + steps[0]  # one log point more than there are
        samples.append(np.array([float(steps[first[0]] if len(first) else never) for first in reached]))
    known = compared(name, *samples)
    shown = (float(np.median(sample)) for sample in samples)
    return [known._replace(numbers=(*(np.inf if each > steps[-1] else each for each in shown), known.numbers[1]))]


def behind(task, name, metric="training_return"):
    """The Gaussian over the better classification loss."""
    known = gap(task, name, final, metric)
    (middle, half), share = known.numbers
    return [known._replace(numbers=((-middle, half), 1 - share), sign=-known.sign)]


def without_noise(task, name):
    """By the mean action where it was logged, else by the most likely one."""
    return ends(task, name, "mean_action_return" if task.again.has("mean_action_return") else "evaluation_return")


def sentences(tasks, judge):
    """Return what is noted of each kind of deterministic policy, on the tasks that are not null."""
    known = {name: task for name, task in tasks.items() if not null_of(task)}
    told = []
    for metric, kind in KINDS.items():
        those = {name: task for name, task in known.items() if task.again.has(metric)}
        found = by_task(those, lambda task, name, metric=metric: judge(task, name, metric))
        told += [f"By the deterministic policy's return ({kind}): {counted(found)}."] if found else []
    return told


def counted(found):
    """Decisions by what became of them."""
    words = {"✓": "as the paper says", "✗": "clearly the contrary", "≈": "no clear difference", "?": "too few runs"}
    marks, _ = marks_of(found)
    names = {mark: [f.name for f, m in zip(found, marks, strict=True) if m == mark] for mark in words}
    return "; ".join(f"{len(of)} {words[mark]} ({', '.join(of)})" for mark, of in names.items() if of)


def apart(task, name):
    """Compare how far runs end from their median, the Gaussian's against those of the better classification loss."""
    (rest, best), loss = ends_of(task), better(task, final, "training_return")
    finals = [task.again.final(each) for each in ("gaussian", loss)]
    far = [abs(each - np.median(each)) for each in finals]
    known = compared(name, *far, paired(task.again.of("gaussian"), task.again.of(loss)))
    return [known._replace(numbers=(*(float(np.median(each)) / (best - rest) for each in far), known.numbers[1]))]


def drawdown(task, name):
    """Compare what is lost of the best log point in the end."""
    (rest, best), loss = ends_of(task), better(task, final, "training_return")
    lost = [(task.again.curve(x).max(1) - task.again.final(x)) / (best - rest) for x in ("gaussian", loss)]
    known = compared(name, *lost, paired(task.again.of("gaussian"), task.again.of(loss)))
    return [known._replace(numbers=(*map(mean_of, lost), known.numbers[1]))]


def order(tasks):
    """Judge whether HL-1-Hot and HL-Gauss differ by less than a tenth; and which is clearly ahead where."""
    ahead = []

    def judge(task, name):
        if task.again.of("hl-gauss").setting["eta"] <= 0.1:
            return [null(name, "the same loss: HL-Gauss's best η is at most 0.1")]
        rest, best = ends_of(task)
        ours, theirs = ((task.again.final(loss) - rest) / (best - rest) for loss in ("hl-gauss", "hl-one-hot"))
        pairs = paired(task.again.of("hl-gauss"), task.again.of("hl-one-hot"))
        ahead.append(compared(name, ours, theirs, pairs))
        return [alike(name, ours, theirs, 0.1, pairs, ahead[-1].numbers[:1])]

    found = judged(by_task(tasks, judge))
    little = [mark for mark in found.marks if mark in "✓✗≈"]
    order = [mark for mark in marks_of(ahead)[0] if mark in "✓✗≈"]
    often = True if len(little) > 1 and 2 * little.count("✓") >= len(little) else None
    often = False if len(little) > 1 and 2 * little.count("✗") > len(little) else often
    changes = True if {"✓", "✗"} <= {*order} else None
    changes = False if len(order) > 1 and {*order} in ({"✓"}, {"✗"}) else changes
    facts = {often, changes}
    known = {frozenset({True}): "holds", frozenset({False}): "does not hold"}
    verdict = known.get(frozenset(facts), "holds in part" if True in facts else "not decidable here")
    return found._replace(verdict=verdict, count=None)


TASKS = {
    "ends_higher": (ends, False, sentences),
    "ends_higher_without_noise": (without_noise, False, None),
    "learns_faster": (learns, False, sentences),
    "learns_sooner": (sooner, False, sentences),
    "acrobot": (behind, True, sentences),
    "alike_between_seeds": (apart, None, None),
    "keeps_what_it_learns": (drawdown, None, None),
}
"""The judge of a task; whether Acrobot alone is asked, all but Acrobot, or None for all; and what is noted too."""


def on_tasks(tasks, claim):
    """A claim of TASKS, and the sentences noted beside it."""
    judge, only, notes = TASKS[claim]
    asked = {name: task for name, task in tasks.items() if only is None or (name == "acrobot") == only}
    return judged(by_task(asked, judge)), notes(asked, judge) if notes else []


def finals_of(grid, loss):
    """The final returns of every setting of a loss, [settings, trials]."""
    found = np.array([runs.finals["training_return"] for runs in grid.runs if runs.setting["loss"] == loss])
    return grid.filled(found, "training_return")


def marginal(grid, loss, field):
    """Each trial's mean final return over the settings that share a value of a field, [values, trials]."""
    values = np.array([runs.setting[field] for runs in grid.runs if runs.setting["loss"] == loss])
    return np.array([finals_of(grid, loss)[values == value].mean(0) for value in sorted({*values})])


def moved(task, loss, field):
    """The best value's less the worst's, chosen by the other half of the trials; None where there is one value."""
    (rest, best), means = ends_of(task), marginal(task.grid, loss, field)
    halves = {0: means[:, ::2], 1: means[:, 1::2]}
    if len(means) < 2:
        return None
    found = np.empty(means.shape[1])
    for here, other in ((0, 1), (1, 0)):
        chosen = halves[other].mean(1)
        found[here::2] = halves[here][chosen.argmax()] - halves[here][chosen.argmin()]
    return found / (best - rest)


def sensitive(loss, field, much=True):
    def judge(task, name):
        by = moved(task, loss, field)
        if by is None:
            return []
        known = against(name, by, 0.1, (mean_of(by),))
        return [known if much else known._replace(sign=-known.sign)]

    return judge


def wide(task, name):
    means, (rest, best) = marginal(task.grid, "hl-gauss", "eta"), ends_of(task)
    return (
        [compared(name, (means[0] - rest) / (best - rest), (means[-1] - rest) / (best - rest))]
        if len(means) > 1
        else []
    )


def similar_bins(task, name):
    ours, theirs = (moved(task, loss, "n_bins") for loss in CLASSIFIED)
    if ours is None or theirs is None:
        return []
    return [alike(name, ours, theirs, 0.1, False, compared(name, ours, theirs).numbers[:1])]


def rates(losses, of, sign):
    """Return a judge of how much the learning rate moves some losses, against another one."""

    def judge(task, name):
        theirs, ours = moved(task, of, "learning_rate"), {x: moved(task, x, "learning_rate") for x in losses}
        known = {f"{name} {LABELS[x]}": by for x, by in ours.items() if by is not None and theirs is not None}
        return [compared(each, *((by, theirs)[::sign])) for each, by in known.items()]

    return judge


def high(task, name):
    """The share of a trial's settings that end above nine tenths of the way to the best setting's mean."""
    rest, _ = ends_of(task)
    best = max(runs.finals["training_return"].mean() for runs in task.grid.runs)
    if not best > rest:
        return []
    theirs, *ours = ((finals_of(task.grid, x) > rest + 0.9 * (best - rest)).mean(0) for x in PAPER)
    return [compared(name, (ours[0] + ours[1]) / 2, theirs)]


GRIDS = {
    "HL-Gauss is sensitive to the learning rate.": sensitive("hl-gauss", "learning_rate"),
    "HL-Gauss is sensitive to η.": sensitive("hl-gauss", "eta"),
    "With η too large HL-Gauss degrades.": wide,
    "HL-Gauss is robust to the number of bins.": sensitive("hl-gauss", "n_bins", much=False),
    "HL-1-Hot is robust to the number of bins.": sensitive("hl-one-hot", "n_bins", much=False),
    "HL-1-Hot is similarly robust to the number of bins as HL-Gauss.": similar_bins,
    "HL-1-Hot is sensitive to the learning rate.": sensitive("hl-one-hot", "learning_rate"),
    "The Gaussian is sensitive to the learning rate.": sensitive("gaussian", "learning_rate"),
    "The Gaussian and HL-1-Hot are also sensitive to the learning rate, as HL-Gauss is.": rates(
        PAPER[:2], "hl-gauss", 1
    ),
    "Classification is more robust to hyperparameters.": rates(CLASSIFIED, "gaussian", -1),
    "Over all settings, a higher fraction of classification's runs reaches a high return.": high,
}
"""The judge of a grid, by the paper's sentence."""


def on_grids(grids, words):
    """A claim of GRIDS."""
    tasks = {name: Task(name, grid, grid) for name, grid in grids.items()}
    return judged(by_task(tasks, GRIDS[words]), unless_contrary="also sensitive" in words)
