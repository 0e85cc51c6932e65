"""Figures."""

from pathlib import Path
from typing import Any

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.layout_engine import ConstrainedLayoutEngine
from matplotlib.ticker import EngFormatter

from galton.analysis.comparison import Results
from galton.analysis.statistics import fill_forward, mean_interval
from galton.envs.base import Environment
from galton.losses import LOSSES

# Okabe and Ito's colours, told apart by readers of every colour vision.
COLORS = dict(zip(LOSSES, ("#000000", "#E69F00", "#0072B2", "#009E73"), strict=False))

_STYLE: Any = {
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.grid": True,
    "grid.color": "#e6e6e6",
    "font.size": 10,
    "legend.frameon": False,
    "svg.hashsalt": "galton",
}


def learning_curves(results: Results, env: Environment | None, title: str) -> Figure:
    """Training and evaluation return over environment steps: mean over runs and its 95% CI; the optimum if known."""
    optimum = env.optimal_return if env is not None else None
    with mpl.rc_context(_STYLE):
        figure = Figure(figsize=(9.5, 4.2), layout=ConstrainedLayoutEngine(wspace=0.05))
        left, right = figure.subplots(1, 2, sharey=True)
        figure.suptitle(title)
        means: list[Any] = [] if optimum is None else [np.array([optimum])]
        for axes, metric, heading in (
            (left, "training_return", "training return"),
            (right, "evaluation_return", "evaluation return, deterministic policy"),
        ):
            means += _draw(axes, results, metric)
            axes.set_title(heading, fontsize=10)
            axes.set_xlabel("environment steps")
            axes.xaxis.set_major_formatter(EngFormatter(sep=""))
            if optimum is not None:
                axes.axhline(optimum, color="#777777", linestyle="--", linewidth=1, label="optimum")
        known = np.concatenate(means)[~np.isnan(np.concatenate(means))]
        if len(known):  # by the means: a single run's crash must not flatten everybody's curve
            margin = 0.05 * np.ptp(known) + 1e-9
            left.set_ylim(known.min() - margin, known.max() + 2 * margin)
        left.set_ylabel("undiscounted return")
        handles, labels = left.get_legend_handles_labels()
        figure.legend(handles, labels, loc="outside lower center", ncols=len(handles))
    return figure


def _draw(axes: Axes, results: Results, metric: str) -> list[Any]:
    """Draw the curves and return their means."""
    means = []
    for loss, result in results.items():
        curves = fill_forward(getattr(result.log, metric).astype(np.float64))
        curves[(result.diverged_at >= 0)[:, None] & (result.steps >= result.diverged_at[:, None])] = np.nan
        interval = mean_interval(curves)
        color, line = COLORS.get(loss), "-" if LOSSES[loss].in_paper else "-."
        axes.plot(result.steps, interval.mean, label=LOSSES[loss].label, linewidth=1.6, color=color, linestyle=line)
        axes.fill_between(result.steps, interval.low, interval.high, color=color, alpha=0.18, linewidth=0)
        means.append(interval.mean)
    axes.set_xlim(0, max(result.steps[-1] for result in results.values()))
    return means


def save(figure: Figure, stem: Path) -> None:
    """As stem.png and stem.svg, the same bytes for the same figure."""
    with mpl.rc_context(_STYLE):
        figure.savefig(stem.with_suffix(".png"), dpi=160)
        figure.savefig(stem.with_suffix(".svg"), metadata={"Date": None})
