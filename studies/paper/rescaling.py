"""Hypotheses (a) and (b): other units of the action, for policies that know of units and those that don't."""

import functools
import json
from collections.abc import Iterator, Mapping
from typing import NamedTuple

import numpy as np
import pyarrow as pa
from matplotlib.figure import Figure

from galton.tasks import TASKS
from galton_experiments.analysis import fit_curves, mean_band, mean_interval, rounded
from galton_experiments.analysis.plots import draw_series, finish, label_rows, look_of, marker_of, panels
from galton_experiments.page import Cell, Claim, Matrix
from galton_experiments.runs import Summary
from galton_experiments.sweep import Setting, Study
from studies.paper import bandit
from studies.paper.changes import Variant
from studies.paper.claims import of_figure
from studies.paper.curves import heading
from studies.paper.figure import figure
from studies.paper.measures import Scores, final_of, logged
from studies.paper.sweeps import MAIN, Budget, Done, Sweep, again, winners_for, with_constants
from studies.paper.trained import Trained

SCALE_TASKS = ("bandit", "lqr", "reacher", "half-cheetah")
SCALES = (0.125, 0.5, 1.0, 2.0, 8.0)
"""The factors of the action box: powers of two, by which floating point changes no digit."""
IN_THE_BOX = "gaussian in units of the box"
"""The name of the Gaussian whose mean and σ are in half-widths of the action box."""


def name_of(setting: Setting) -> str:
    """The loss, or IN_THE_BOX for the Gaussian in those units."""
    return IN_THE_BOX if setting["box_units"] else setting["loss"]


def _settings(main: Summary, budget: Budget) -> Iterator[Setting]:
    """Each loss's best setting of the main experiment, and the Gaussian's in units of the box."""
    found = winners_for(main, budget)
    yield from found
    yield from (setting.replace(box_units=1.0) for setting in found if setting["loss"] == "gaussian")


def _sweep(task: str, scale: float) -> Sweep:
    n = 10 if TASKS[task].in_jax else 5
    constants = {"action_scale": scale} if scale != 1 else {}
    name, trials = f"scale-{task}-{scale:g}", lambda budget: 2 if budget == "smoke" else n
    return again(MAIN[task], _settings, name=name, trials=trials, env_kwargs=constants)


SWEEPS = {(task, scale): _sweep(task, scale) for task in SCALE_TASKS for scale in SCALES}
"""The sweeps by task and scale, all with the same settings and seeds, so that only the scale differs."""


def _variant(name: str, scale: float, other: str) -> Variant:
    """All tasks at one scale, without one of the two Gaussians."""

    def winners(_: str, chosen: Summary, done: Summary) -> Mapping[Setting, Setting]:
        kept = (setting for setting in done.study.settings if name_of(setting) != other)
        return {chosen.best[setting["loss"]].setting: setting for setting in kept}

    return Variant(name, {task: (MAIN[task], SWEEPS[task, scale]) for task in SCALE_TASKS}, winners)


VARIANTS = (
    *(_variant(f"action box × {scale:g}", scale, IN_THE_BOX) for scale in SCALES if scale != 1),
    _variant(f"× {SCALES[-1]:g}, the Gaussian in units of the box", SCALES[-1], "gaussian"),
)


class At(NamedTuple):
    """A setting at one scale."""

    summary: Summary
    """The sweep that trained it, all settings at that scale."""
    setting: Setting

    def final(self, kind: str) -> Scores:
        """Final returns; of the deterministic policy by its mean action where that was logged."""
        metric = "training_return" if kind == "training" else [*logged(self.summary)][-1]
        return final_of(self.summary, self.setting, metric)


def across(trained: Trained, task: str) -> dict[str, dict[float, At]]:
    """The runs of each loss, and of IN_THE_BOX, at each scale that is done."""
    found: dict[str, dict[float, At]] = {}
    for scale in SCALES:
        if summary := trained.of(SWEEPS[task, scale]):
            for setting in summary.study.settings:
                found.setdefault(name_of(setting), {})[scale] = At(summary, setting)
    return found


def are_equal(by_scale: Mapping[float, At]) -> bool:
    """Say whether all that is kept of the runs is the same to the bit at every scale, but for what is in its units.

    That is σ, and for a density its logarithm too, and so its entropy and loss.
    """
    is_density = any(at.setting["box_units"] for at in by_scale.values())
    of_density = {"final_entropy", "entropy", "final_policy_loss"} if is_density else set()
    first, *others = (at.summary.part([at.setting]).table for at in by_scale.values())
    names = {*first.column_names} - {"setting", "final_sigma"} - of_density
    return all(_bits(first[name]) == _bits(other[name]) for other in others for name in names)


def _bits(column: pa.ChunkedArray) -> bytes:
    """All numbers of a column, or of its lists; of two NaN at one place Arrow says that they differ."""
    values = column.combine_chunks()
    return (values.flatten() if pa.types.is_nested(values.type) else values).to_numpy(zero_copy_only=False).tobytes()


def markdown(trained: Trained) -> str:
    """Final training returns by the scale of the box as a Markdown table, and whether the runs are the same bits."""
    heads = [f"× {scale:g}" for scale in SCALES]
    lines = ["| the action box | | " + " | ".join(heads) + " | equal to the bit |", "|---" * (len(SCALES) + 3) + "|"]
    for task in SCALE_TASKS:
        known = {name: by_scale for name, by_scale in across(trained, task).items() if len(by_scale) > 1}
        for name, by_scale in known.items():
            finals = {scale: mean_interval(at.final("training")) for scale, at in by_scale.items()}
            cells = [rounded(finals[scale], "") if scale in finals else "—" for scale in SCALES]
            same = "yes" if are_equal(by_scale) else "no"
            lines.append(f"| {TASKS[task].title} | {_look(name)[0]} | {' | '.join(cells)} | {same} |")
    return "\n".join(lines) if len(lines) > 2 else ""


def draw(trained: Trained) -> Figure:
    """Final returns by the scale of the box, a column per task: with exploration, and without."""
    found = {task: across(trained, task) for task in SCALE_TASKS}
    found = {task: series for task, series in found.items() if any(len(by_scale) > 1 for by_scale in series.values())}
    titles = [f"{heading(task)}\nequal to the bit: {_equal(series)}" for task, series in found.items()]
    drawing, axes = panels(2 * len(found), columns=max(1, len(found)))
    for row, kind in enumerate(("training", "deterministic")):
        for column, series in enumerate(found.values()):
            panel = axes[row * len(found) + column]
            drawn = []
            for name, by_scale in series.items():
                finals = np.stack([at.final(kind) for at in by_scale.values()], 1)
                drawn.append(mean_band([finals]))
                draw_series(panel, [*by_scale], drawn[-1], *_look(name))
            panel.set_xscale("log", base=2)
            panel.set_xlim(SCALES[0] / 1.25, SCALES[-1] * 1.25)
            panel.set_xticks(SCALES, [f"{scale:g}" for scale in SCALES])
            panel.set_title(titles[column])
            panel.set_xlabel("action box times")
            fit_curves(panel, drawn)
        label_rows(axes[row * len(found) : (row + 1) * len(found)], f"{kind} return")
    finish(drawing, axes)
    return drawing


def _equal(series: Mapping[str, Mapping[float, At]]) -> str:
    """Of how many losses, but the Gaussian in the environment's units, the runs are equal across scales."""
    equal = [are_equal(by_scale) for name, by_scale in series.items() if len(by_scale) > 1 and name != "gaussian"]
    return f"{sum(equal)} of {len(equal)}"


def _look(name: str) -> tuple[str, str, str, str]:
    """Label, colour, line style and marker."""
    if name != IN_THE_BOX:
        return *look_of(name), marker_of(name)
    return f"{look_of('gaussian')[0]}, units of the box", "0.5", ":", "X"


_PREFIX = "boxed-"
_UNITS = ("raw units", "units of the box")
_HALF_WIDTH = 10.0
"""Of the bandit's box: actions in [−1, 1] are a tenth of its own."""


@functools.cache
def _boxed(raw: Sweep) -> Sweep:
    """The same sweep where the policy acts in [−1, 1]."""

    def study(budget: Budget, done: Done) -> Study:
        plain = raw.study(budget, _without_prefix(done))
        return with_constants(plain, json.loads(plain.env_kwargs) | {"action_scale": 1 / _HALF_WIDTH})

    before = None if raw.winners_of is None else _boxed(raw.winners_of)
    return Sweep(_PREFIX + raw.name, study, winners_of=before)


def _without_prefix(done: Done) -> Done:
    return {name.removeprefix(_PREFIX): of for name, of in done.items() if name.startswith(_PREFIX)}


IN_BOX = tuple(map(_boxed, bandit.FIGURE.sweeps))
"""The sweeps of Figure 3, in units of the box."""


def in_the_box(trained: Trained) -> Trained:
    """The bandit in units of its box, in the place of the bandit."""
    return Trained(_without_prefix(trained.sweeps))


@functools.lru_cache(maxsize=1)  # the page and tables.md have it
def table(trained: Trained) -> Matrix:
    """Judge what the paper says of Figure 3, in both units."""
    sides = trained, in_the_box(trained)
    if not sides[1].sweeps:
        return Matrix("the bandit", _UNITS, {})
    judged = [[judge(side) for judge in of_figure("figure-3")] for side in sides]
    rows = {pair[0].words: [cell(claim) for claim in pair] for pair in zip(*judged, strict=True)}
    return Matrix("the bandit", _UNITS, rows)


def cell(claim: Claim) -> Cell:
    """Count a claim's decisions that are clearly as the paper says, of how many, and those that are the contrary."""
    if claim.count is None:
        return Cell("—")
    contrary = sum(line.startswith("✗") for line in claim.number.splitlines())
    told = "{} of {}".format(*claim.count)
    return Cell(f"{told}, {contrary} contrary" if contrary else told, claim.verdict)


BOXED = figure("figure-3-boxed", lambda trained: bandit.draw(in_the_box(trained)), IN_BOX, table=table)
