"""One thing is changed at a time, to see why the paper's effect does or does not appear."""

import dataclasses
import functools
import textwrap
from collections.abc import Iterator, Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Float
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.typing import ColorType

from galton.losses import LOSSES
from galton.tasks import TASKS
from galton_experiments.analysis import Interval, mean_band, mean_interval
from galton_experiments.analysis.plots import draw_marks, finish, fit, look_of, marker_of, panels
from galton_experiments.page import Table
from galton_experiments.runs import Summary
from galton_experiments.sweep import Setting, Study, expand, mean_returns, task_defaults
from studies.paper.changes import Variant
from studies.paper.curves import draw_levels, heading, numbered
from studies.paper.figure import figure
from studies.paper.measures import CLASSIFICATION
from studies.paper.sweeps import Budget, Done, Sweep, again, task_study
from studies.paper.trained import Trained

CHANGES: dict[str, dict[str, float | bool]] = {
    "as in the main experiment": {},
    "λ = 0.95": {"gae_lambda": 0.95},
    "entropy bonus 0.01": {"ent_coef": 0.01},
    "λ = 0.95 and entropy bonus": {"gae_lambda": 0.95, "ent_coef": 0.01},
    "advantages normalised": {"normalize_advantage": True},
    "observations normalised": {"normalize_observation": True},
    "rewards normalised": {"normalize_reward": True},
    "batch of 4 × 5": {"n_envs": 4, "n_steps": 5},
    "batch of 8 × 20": {"n_envs": 8, "n_steps": 20},
    "all of these, batch of 8 × 20": {
        "gae_lambda": 0.95,
        "ent_coef": 0.01,
        "normalize_advantage": True,
        "normalize_observation": True,
        "normalize_reward": True,
        "n_envs": 8,
        "n_steps": 20,
    },
}
"""The changes of the study of causes, one thing at a time and then together."""
WHY_TASKS = ("lqr", "mountain-car", "acrobot")
WHY_RATES = [3e-4, 1e-3, 3e-3]
"""The learning rates of the study of causes; the last is beyond the paper's grid."""


def _sweep(task: str) -> Sweep:
    """The sweep of all losses with each of CHANGES on a task."""

    def study(budget: Budget, _: Done) -> Study:
        smoke = budget == "smoke"
        rates, bins = ([1e-3], 20) if smoke else (WHY_RATES, 100)
        names = ["as in the main experiment", "λ = 0.95"] if smoke else list(CHANGES)
        losses: list[dict[str, object]] = [
            {"loss": ["gaussian", "hl-one-hot"]},
            {"loss": "hl-gauss", "eta": 0.25},
            {"loss": "hl-gauss-centred", "eta": [2.0] if smoke else [2.0, 4.0]},
        ]
        blocks = [{"learning_rate": rates, "n_bins": bins} | loss | CHANGES[name] for name in names for loss in losses]
        settings = expand(blocks, task_defaults(TASKS[task].env))
        main = task_study(task, budget, settings[:1])
        trials = {"smoke": 2, "small": 3, "grid": 5, "paper": 5}[budget]
        logs = main.logs if smoke else 125  # for batches of 20 and 160
        return dataclasses.replace(main, settings=settings, trials=trials, logs=logs)

    return Sweep(f"why-{task}", study, f"why on {TASKS[task].title}")


def best_of_each(summary: Summary) -> tuple[Setting, ...]:
    """Of settings alike but for learning rate and η the one with the highest mean final training return.

    One with a run that diverged loses to any other.
    """
    means = mean_returns(summary.study, summary.table)
    found: dict[frozenset[tuple[str, object]], Setting] = {}
    for setting, mean in means.items():
        alike = frozenset((setting.record() | {"learning_rate": 0.0, "eta": 0.0}).items())
        if alike not in found or mean > means[found[alike]]:
            found[alike] = setting
    return tuple(found.values())


SWEEPS = {task: _sweep(task) for task in WHY_TASKS}
"""The sweep of each task: all losses under each change."""
AGAIN = {task: again(SWEEPS[task], lambda summary, _: best_of_each(summary)) for task in WHY_TASKS}
"""The sweep of each task that trains each loss's best setting under each change on fresh seeds."""


METRICS = {
    "training_return": "training return",
    "entropy": "entropy, nats",
    "explained_variance": "critic's explained variance, median",
    "edge_share": "actions at the edge",
    "hl_gauss_bias": "HL-Gauss bias",
}
"""Final means of these tell what the policies and critics look like in the end."""


class Outcome(NamedTuple):
    """An outcome is how a loss ends under a change, with the best of its learning rates and η, on fresh seeds."""

    setting: Setting
    finals: dict[str, Float[np.ndarray, " trials"]]
    """The final mean of each of METRICS, by trial; NaN for a run that diverged."""


def retrained(trained: Trained) -> dict[str, Summary]:
    """The winners' runs on fresh seeds, by task, where they are done."""
    return {task: done for task, sweep in AGAIN.items() if (done := trained.of(sweep))}


def outcomes(summary: Summary) -> dict[tuple[str, str], Outcome]:
    """Return the outcome of each loss under each change: the winners on fresh seeds, by change and loss."""
    metrics = {metric: summary.final(metric) for metric in METRICS}
    return {
        (change_of(setting, summary.study.env), setting["loss"]): Outcome(
            setting, {metric: values[summary.rows(setting)] for metric, values in metrics.items()}
        )
        for setting in summary.study.settings
    }


def change_of(setting: Setting, env: str) -> str:
    """The name in CHANGES of what a setting has changed from the task's defaults."""
    record, plain = setting.record(), _plain(env)
    fields = {field for change in CHANGES.values() for field in change}
    given = {field: record[field] for field in fields if record[field] != plain[field]}
    for name, change in CHANGES.items():
        if {field: value for field, value in change.items() if value != plain[field]} == given:
            return name
    raise ValueError(f"a setting has {given}, which is none of CHANGES")


@functools.cache
def _plain(env: str) -> dict[str, Any]:
    return Setting(task_defaults(env)).record()


def variants() -> Iterator[Variant]:
    """The winners under each change, in the place of the main experiment."""
    sweeps = {task: (SWEEPS[task], AGAIN[task]) for task in WHY_TASKS}
    for name in filter(CHANGES.get, CHANGES):

        def winners(task: str, _: Summary, again: Summary, name: str = name) -> Mapping[Setting, Setting]:
            return {each: each for each in again.study.settings if change_of(each, TASKS[task].env) == name}

        yield Variant(name, sweeps, winners)


def draw(trained: Trained) -> Figure:
    """A panel per task: changes across, returns up, a mark per loss for training and one without exploration."""
    found = retrained(trained)
    drawing, axes = panels(len(found), columns=1, height=3.0)
    drawing.set_figwidth(10.5)
    for panel, (task, summary) in zip(axes, found.items(), strict=True):
        _draw_task(panel, task, summary)
    finish(drawing, axes, [look_of(loss)[0] + word for word, _ in _SHOWN.values() for loss in LOSSES])
    return drawing


def _draw_task(axes: Axes, task: str, summary: Summary) -> None:
    """A mean far from all others is written down, and does not stretch the axis."""
    results = outcomes(summary)
    losses = list(dict.fromkeys(loss for _, loss in results))
    changes = _by_classification({key: outcome.finals["training_return"] for key, outcome in results.items()})
    marks = {
        (change, loss, metric): mean_band([summary.final(metric)[summary.rows(outcome.setting)]])
        for (change, loss), outcome in results.items()
        for metric in _SHOWN
    }
    bottom, top = _fit_marks(axes, task, np.array([mark.mean for mark in marks.values()]))
    for i, loss in enumerate(losses):
        label, color, _ = look_of(loss)
        for metric, (word, aside) in _SHOWN.items():
            shift = 0.2 * (i - (len(losses) - 1) / 2) + aside
            intervals = [marks[change, loss, metric] for change in changes]
            draw_marks(axes, intervals, label + word, color, shift, marker_of(loss), hollow=bool(word))
            _draw_beyond(axes, intervals, bottom, top, shift, color, line=bool(word))
    axes.set_xticks(range(len(changes)), [textwrap.fill(change, 14) for change in changes], fontsize=8)
    axes.set_xlim(-0.5, len(changes) - 0.5)
    axes.set_title(numbered(heading(task), summary, every=True), fontsize=10)
    axes.set_xlabel("change")
    axes.set_ylabel("final return")


_SHOWN = {"training_return": ("", -0.04), "evaluation_return": (": deterministic", 0.04)}
"""The metrics of the figure, with what follows a loss's name, and where they stand beside its place."""


def _by_classification(finals: Mapping[tuple[str, str], Float[np.ndarray, " trials"]]) -> list[str]:
    """The changes: none first, then by what the better of the paper's classification losses earns."""
    earned: dict[str, float] = {}
    for (change, loss), values in finals.items():
        mean = float(mean_interval(values).mean) if loss in CLASSIFICATION else np.nan
        earned[change] = float(np.fmax(earned.get(change, np.nan), mean))
    unchanged, *others = sorted(earned, key=lambda change: change != next(iter(CHANGES)))
    return [unchanged, *sorted(others, key=lambda change: np.nan_to_num(earned[change], nan=-np.inf))]


def _fit_marks(axes: Axes, task: str, means: Float[np.ndarray, " n"]) -> tuple[float, float]:
    """Fit the y axis to these means and the task's levels; the values beyond which none stretches it."""
    rest = TASKS[task].at_rest
    low, high = np.nanquantile(means, [0.1, 0.9])
    low = low if rest is None else min(low, rest)
    bottom, top = float(low - 2 * (high - low)), float(high + 2 * (high - low))
    top = top if np.nanmax(means) > top else np.inf
    kept = means[means >= bottom]
    levels = np.array(draw_levels(axes, task))
    fit(axes, [each[each <= top] for each in (kept, levels)])
    if np.isfinite(top):  # room for words
        least, most = axes.get_ylim()
        axes.set_ylim(least, most + 0.2 * (most - least))
    return bottom, top


def _draw_beyond(
    axes: Axes, intervals: Sequence[Interval], bottom: float, top: float, shift: float, color: ColorType, line: int
) -> None:
    """An arrow where an interval goes on below the axis; where a mean lies beyond it its numbers, on that line."""
    low, high = axes.get_ylim()
    for x, interval in enumerate(intervals):
        if interval.mean < bottom:
            _write(axes, f" ↓ {interval:.0f}", (x + shift, low), 11 * line, color, "bottom")
        elif interval.mean > top:
            _write(axes, f" ↑ {interval:.0f}", (x + shift, high), -11 * line, color, "top")
        elif interval.low < low:
            axes.plot(x + shift, low, marker=11, color=color, ms=5, clip_on=False)  # points down, from the axis


def _write(axes: Axes, words: str, at: tuple[float, float], above: int, color: ColorType, side: str) -> None:
    axes.annotate(words, at, (0, above), textcoords="offset points", color=color, fontsize=8, va=side, clip_on=False)


def causes(trained: Trained) -> Table:
    """Tabulate what the policies look like in the end, under each change."""
    rows = []
    for task, summary in retrained(trained).items():
        title = trained.title(task)
        for (change, loss), outcome in outcomes(summary).items():
            cells = [
                f"{np.nanmedian(values):.2f}".replace("-", "−")  # it may be −∞
                if metric == "explained_variance"
                else f"{mean_interval(values):.2f}"
                for metric, values in outcome.finals.items()
            ]
            rows.append([title, change, LOSSES[loss].label, outcome.setting.brief(), *cells])
    return Table(["task", "change", "loss", "setting", *METRICS.values()], rows)


FIGURE = figure("why", draw, tuple(sweep for task in WHY_TASKS for sweep in (SWEEPS[task], AGAIN[task])), table=causes)
