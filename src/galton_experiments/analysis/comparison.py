"""Several losses on one task: a row for each, the verdicts, the figure and the numbers behind them."""

import dataclasses
import math
from collections.abc import Mapping

import numpy as np
import pyarrow as pa
from matplotlib.figure import Figure

from galton.agents import words_of
from galton.decimals import fitting
from galton.envs.base import Environment
from galton.losses import LOSSES
from galton.training.train import Result
from galton_experiments.analysis.plots import (
    colors_of,
    draw_level,
    draw_series,
    finish,
    fit,
    look_of,
    over_steps,
    panels,
)
from galton_experiments.analysis.statistics import (
    ALPHA,
    Comparison,
    Interval,
    compare,
    fill_until,
    least_p,
    mean_interval,
)
from galton_experiments.analysis.verdicts import WORDS, decide

Results = Mapping[str, Result]
"""The trained runs of each loss, as `named` calls it."""


def named(loss: str, preset: str = "") -> str:
    """Name a loss in a comparison, with the preset that its settings are of."""
    return f"{loss}, preset {preset}" if preset else loss


def label_of(name: str) -> str:
    """Return the label that tables and figures have for it; KeyError for none of LOSSES."""
    loss, comma, preset = name.partition(",")
    return LOSSES[loss].label + comma + preset


@dataclasses.dataclass(frozen=True)
class Row:
    """A row of a comparison's table describes the runs of one loss."""

    loss: str
    """As `named` calls it."""
    training_return: Interval
    """Mean return over the last 5% of training, with its interval over runs."""
    evaluation_return: Interval
    rest_to_optimum: float | None
    """Of the evaluation return, on a scale where rest is 0 and the optimum is 1 (see `rest_of`)."""
    steps_per_second: float
    compile_seconds: float
    diverged: int
    runs: int


def rest_of(env: Environment | None, at_rest: float | None) -> float | None:
    """Return the best return without learning, of doing nothing or of acting at random; None if neither is known.

    Args:
        env: whose `random_return` is the latter.
        at_rest: the mean return of doing nothing there, if it is known.
    """
    known = (at_rest, None if env is None else env.random_return)
    return max((value for value in known if value is not None), default=None)


def summarise(results: Results, env: Environment | None, at_rest: float | None = None) -> list[Row]:
    """A row per loss, with its share of the way from rest to the optimum where the environment knows that.

    Diverged runs are counted and left out of the means.
    """
    rows, rest = [], rest_of(env, at_rest)
    for loss, result in results.items():
        evaluation = mean_interval(result.final("evaluation_return"))
        share = None
        if env is not None and env.optimal_return is not None and rest is not None:
            share = float((evaluation.mean - rest) / (env.optimal_return - rest))
            share = None if math.isnan(share) else share
        rows.append(
            Row(
                loss,
                mean_interval(result.final("training_return")),
                evaluation,
                share,
                result.steps_per_second,
                result.compile_seconds,
                int((result.diverged_at >= 0).sum()),
                len(result.seeds),
            )
        )
    return rows


def verdicts(results: Results, baseline: str = "gaussian") -> list[str]:
    """Judge each loss against the baseline by the final returns, a sentence each; none without the baseline's runs.

    The baseline is the first of that loss.

    Runs of one seed are pairs. A diverged run is below all others, and counts as the worst of them in the mean. The p
    values of the rank tests are adjusted for all sentences by Holm's method. Where none of these could be clear, runs
    are too few.
    """
    found: dict[str, Comparison] = {}
    baseline = next((name for name in results if name.partition(",")[0] == baseline), baseline)
    for metric, name in (("training_return", "training"), ("evaluation_return", "evaluation")):
        finals = {loss: result.final(metric) for loss, result in results.items()}
        known = np.concatenate([of[~np.isnan(of)] for of in finals.values()])
        for loss in finals:
            if loss != baseline and baseline in finals and known.size:
                ours, theirs = (
                    np.where(results[name].diverged_at >= 0, -np.inf, finals[name]) for name in (loss, baseline)
                )
                sentence = f"{label_of(loss)} − {label_of(baseline)}, {name} return"
                found[sentence] = compare(ours, theirs, paired=True, worst=known.min())
    decided = decide(found)
    n = min((len(result.seeds) for result in results.values()), default=0)
    few = least_p(n, n, paired=True) * sum(not math.isnan(each.p) for each in found.values()) >= ALPHA
    form = fitting(*(each.difference.mean for each in found.values()))
    return [
        f"{what}: {each.difference:+{form}}: {WORDS['?' if few else decided[what].mark]}"
        for what, each in found.items()
    ]


def learning_curves(results: Results, env: Environment | None, title: str) -> Figure:
    """Training and evaluation return over environment steps: mean over runs and its 95% CI; the optimum if known."""
    optimum = env.optimal_return if env is not None else None
    figure, (left, right) = panels(2, height=3.7, width=4.55)
    right.sharey(left)
    figure.suptitle(title)
    colors = colors_of([words_of(result.agent)["loss"] for result in results.values()])
    means: list[np.ndarray | np.float64] = [] if optimum is None else [np.array([optimum])]
    for axes, metric, heading in (
        (left, "training_return", "training return"),
        (right, "evaluation_return", "evaluation return, deterministic policy"),
    ):
        for (loss, result), color in zip(results.items(), colors, strict=True):
            curves = getattr(result.log, metric).astype(np.float64)
            interval = mean_interval(fill_until(curves, result.steps, result.diverged_at))
            dashes = look_of(loss)[2] if loss in LOSSES else "-"
            draw_series(axes, result.steps, interval, label_of(loss), color, dashes)
            means.append(interval.mean)
        axes.set_title(heading, fontsize=10)
        over_steps(axes, float(max(result.steps[-1] for result in results.values())))
        if optimum is not None:
            draw_level(axes, optimum, "optimum")
    fit(left, means)
    left.set_ylabel("undiscounted return")
    finish(figure, [left])
    return figure


def curves(results: Results) -> pa.Table:
    """All that was recorded, a row per loss, seed and log point."""
    parts = []
    for loss, result in results.items():
        n_runs, n_logs = len(result.seeds), len(result.steps)
        columns: dict[str, object] = {
            "loss": [loss] * (n_runs * n_logs),
            "seed": np.repeat(result.seeds, n_logs),
            "step": np.tile(result.steps, n_runs),
            "diverged_at": np.repeat(result.diverged_at, n_logs),
        }
        columns |= {name: curve.ravel() for name, curve in result.log.columns().items()}
        parts.append(pa.table(columns))
    return pa.concat_tables(parts, promote_options="default")
