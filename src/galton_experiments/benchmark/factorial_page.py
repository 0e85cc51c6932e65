"""A factorial benchmark's results become the sentences, tables, figures and sections of its page."""

from collections.abc import Callable, Mapping

import numpy as np
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from galton_experiments.analysis.plots import draw_series, finish, panels
from galton_experiments.analysis.statistics import Interval
from galton_experiments.benchmark import figures, tables
from galton_experiments.benchmark.found import Found
from galton_experiments.benchmark.protocol import Method
from galton_experiments.benchmark.standings import UNKNOWN, with_worst
from galton_experiments.page.page import Section, Table

_FEWEST = 8
"""Of tasks. With fewer, intervals that draw tasks again are too narrow."""
_WAYS = {
    "top_quarter": "best quarter of draws",
    "one_setting": "one setting",
    "per_task": "tuned for each task",
    "same_draw": "same draw",
}
"""The words for each way of comparing methods, by the field of `Factorial`; the first is the answer."""
_TEXT = (
    "P(above) is the chance that a run is above one of the baseline's on a task that is drawn at random; a tie counts "
    "half, and a diverged run is below all others. One setting is the draw with the highest mean percentile on all "
    "tasks but the one that judges it. The best quarter of draws is selected in the same way, and each of it is "
    "compared with each of the baseline's, since a single draw is mostly luck. A method that is tuned for each task "
    "has the draw with the highest mean percentile there. Half of the seeds select, the others judge, and then the "
    "other way round. With the same draw P is averaged over all draws, and nothing is selected.",
    "At equal time the slower of two methods is read where the faster one ends. A learning rate that decays has not "
    "decayed there yet, so this is less than the slower method would reach in that time. The time of a step is the "
    "file's, or that of the runs.",
    "The 95% intervals draw tasks, draws and each task's seeds again. Nothing is adjusted for the number of methods.",
)
_BEST_OF = (
    "The mean percentile that the best of n draws has, over all subsets of n draws. It is selected on all other tasks "
    "and by other seeds than those that judge it."
)
_DRAWS = (
    "The score is the mean percentile over all tasks and seeds; the highest is the one setting to begin with. The "
    "others are mean returns; a diverged run counts as the worst of any method on the task."
)


def sentences(found: Found) -> list[str]:
    """Say how each method's best quarter of draws does against the baseline's, the highest P first."""
    base, n = found.protocol.baseline.label, len(found.protocol.tasks)
    said = []
    for method in sorted(_others(found), key=lambda method: -float(_p(found, method, "top_quarter").mean)):
        p, timed = _p(found, method, "top_quarter"), _p(found, method, "top_quarter", timed=True)
        at_equal_time = "" if np.isnan(timed.mean) else f", and with {timed:.2f} at equal time"
        said.append(f"With the best quarter of draws {method.label} is above {base} with P = {p:.2f}{at_equal_time}.")
        if n >= _FEWEST:
            side = "ahead" if p.low > 0.5 else "behind" if p.high < 0.5 else ""
            said[-1] += f" It is clearly {side}." if side else " Neither is clearly ahead."
    few = "" if n >= _FEWEST else f" There are {n} tasks, too few for anything to be clear."
    return [*said, f"Draws are judged on tasks and by seeds that had no part in selecting them.{few}"]


def above(found: Found) -> Table:
    """P(above the baseline) of each method in every way of comparing, with its interval."""
    rows = []
    for method in _others(found):
        times = [*found.factorial.times.get(method.name, {}).values()]
        of_step = f"{np.exp(np.mean(np.log(times))):.2f}" if times else "—"
        for way, words in _WAYS.items():
            rows.append(
                [method.label, words, *(f"{_p(found, method, way, timed):.2f}" for timed in (False, True)), of_step]
            )
    return Table(["method", "setting", "equal steps", "equal time", "time of a step"], rows)


def above_by_task(found: Found) -> Table:
    """P on each task by itself, of the settings that are selected; a task has too few runs for an interval."""
    rows = []
    for method in _others(found):
        for way in [way for way in _WAYS if way != "same_draw"]:
            for timed, words in ((False, ""), (True, ", equal time")):
                where = _row(found, method, f"{way}_by_task", timed)
                if where is not None:
                    rows.append([method.label, _WAYS[way] + words, *(f"{p:.2f}" for p in where)])
    return Table(["method", "setting", *(task.label for task in found.protocol.tasks)], rows)


def best_of(found: Found) -> Table:
    """The score of the best of n draws, and by how much it is above the baseline's."""
    n, known = found.protocol.budget.settings, found.factorial.equal_steps
    sizes = sorted({size for size in (1, 2, 4, 8, 16, 32, 64) if size < n} | {n})
    rows = []
    for i, method in enumerate(found.protocol.methods):
        rows.append([method.label, *(f"{_at(known.best_of, i, size - 1):.2f}" for size in sizes)])
        if method != found.protocol.baseline:
            gains = (_at(known.best_of_gain, i, size - 1) for size in sizes)
            rows.append([f"{method.label} − {found.protocol.baseline.label}", *(f"{gain:+.2f}" for gain in gains)])
    return Table(["method", *(f"of {size}" for size in sizes)], rows)


def drawn(found: Found) -> Table:
    """Every draw of every method: what it is, its score and its mean return on each task."""
    anchors, rows = [*found.protocol.anchors], []
    returns = {runs.task: _returns(found, i) for i, runs in enumerate(found.tuning)}
    forms = {
        task: tables.form([x for of in of_method.values() for x in of.tolist()]) for task, of_method in returns.items()
    }
    for method in found.protocol.methods:
        scores = np.mean([of_method[method.name].mean(1) for of_method in found.scores.values()], axis=0)
        for i, fields in enumerate(found.draws[method.name]):
            of_tasks = (tables.number(float(of[method.name][i]), forms[task]) for task, of in returns.items())
            name = f"{i}, {anchors[i]}" if i < len(anchors) else f"{i}"
            rows.append([method.label, name, tables.number(scores[i], ".2f"), *of_tasks, tables.drawn_as_text(fields)])
    return Table(["method", "draw", "score", *(task.label for task in found.protocol.tasks), "what it drew"], rows)


def best_of_figure(found: Found) -> Figure:
    """The table `best_of` as curves with their intervals."""
    n, known = found.protocol.budget.settings, found.factorial.equal_steps
    names = [method.name for method in found.protocol.methods]
    figure, axes = panels(1 if n > 1 else 0, height=3.4, width=5.2)
    for panel in axes:
        for method, shade in zip(figures.leading(found), figures.colors(found), strict=True):
            draw_series(
                panel, np.arange(1, n + 1), _at(known.best_of, names.index(method.name)), method.label, shade, "-", "o"
            )
        panel.set_xlabel("draws")
        panel.set_ylabel("mean percentile of the best")
        panel.xaxis.set_major_locator(MaxNLocator(integer=True))
    finish(figure, axes)
    return figure


def same_draw_figure(found: Found) -> Figure:
    """Each draw's score under every method beside its score under the baseline; anchors are squares."""
    others = [method for method in figures.leading(found) if method != found.protocol.baseline]
    mean = {
        m.name: np.mean([of[m.name].mean(1) for of in found.scores.values()], axis=0) for m in found.protocol.methods
    }
    shades = dict(zip((method.name for method in figures.leading(found)), figures.colors(found), strict=True))
    figure, axes = panels(len(others), columns=3, height=3.2)
    n, x = len(found.protocol.anchors), mean[found.protocol.baseline.name]
    for panel, method in zip(axes, others, strict=True):
        panel.plot([0, 1], [0, 1], color="0.6", lw=1)
        for part, mark, words in ((slice(n, None), "o", "draw"), (slice(n), "s", "anchor")):
            if len(x[part]):
                y = mean[method.name][part]
                panel.plot(x[part], y, mark, color=shades[method.name], ms=5, gid=words)
        panel.set_xlabel(f"score, {found.protocol.baseline.label}")
        panel.set_ylabel(f"score, {method.label}")
        panel.set_xlim(0, 1)
        panel.set_ylim(0, 1)
    finish(figure, [])
    return figure


FIGURES: dict[str, Callable[[Found], Figure]] = {"same-draw": same_draw_figure, "best-of-n": best_of_figure}
"""The figures by name; one without axes is left out."""


def sections(found: Found, drawn_already: Mapping[str, Figure]) -> list[Section]:
    """The sections that stand in the place of those of a benchmark in stages."""
    base, metric = found.protocol.baseline.label, tables.metric(found)
    same = "A mark is a draw, square for an anchor. Above the line it has a higher score under the method."
    same = f"{same} {figures.few(found)}".strip()
    return [
        Section("above", f"P(above {base}) by {metric}", table=above(found), paragraphs=_TEXT),
        Section("above-by-task", f"P(above {base}) on each task", table=above_by_task(found)),
        Section("same-draw", "The same draw under both methods", same, drawn_already["same-draw"]),
        Section("best-of-n", "What tuning brings", _BEST_OF, drawn_already.get("best-of-n"), best_of(found)),
        Section("draws", f"Every draw, by {metric}", table=drawn(found), paragraphs=(_DRAWS,)),
    ]


def _others(found: Found) -> list[Method]:
    return [method for method in found.protocol.methods if method != found.protocol.baseline]


def _row(found: Found, method: Method, field: str, timed: bool) -> np.ndarray | Interval | None:
    """A method's numbers in a field of `Factorial`; None where no time of a step is known."""
    known = found.factorial
    if timed and method.name not in known.equal_time:
        return None
    of, i = (known.equal_time[method.name], 1) if timed else (known.equal_steps, found.protocol.methods.index(method))
    numbers = getattr(of, field)
    return _at(numbers, i) if isinstance(numbers, Interval) else np.asarray(numbers[i])


def _p(found: Found, method: Method, way: str, timed: bool = False) -> Interval:
    """P(above the baseline), NaN where no time of a step is known."""
    row = _row(found, method, way, timed)
    return row if isinstance(row, Interval) else UNKNOWN


def _at(interval: Interval, *place: int) -> Interval:
    """One of several intervals."""
    return Interval(*(np.asarray(numbers)[place] for numbers in interval))


def _returns(found: Found, task: int) -> dict[str, np.ndarray]:
    """The mean return of each draw on a task, by method."""
    finals = {method.name: found.tuning[task].finals(method.name, "draw") for method in found.protocol.methods}
    return {name: runs.mean(1) for name, runs in with_worst(finals).items()}
