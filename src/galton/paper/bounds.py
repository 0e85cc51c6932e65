"""What the samples of `gradients` say of Propositions 1 and 2 (§4.3)."""

from collections.abc import Iterator
from typing import Any, NamedTuple

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc

from galton.losses import LOSSES
from galton.paper.gradients import Sample

Rows = dict[str, np.ndarray]
Series = tuple[str, str, str]
"""What samples are sorted by: task, loss and reading of the Gaussian's σ."""


def read(table: pa.Table) -> Rows:
    """The columns in float64, |A|, and three that may be NaN: norm / bound, and each over |A| (l + ‖f‖)."""
    rows = {name: np.asarray(table.column(name).to_numpy()) for name in table.column_names}
    rows |= {name: rows[name].astype(np.float64) for name in Sample._fields}
    rows["|advantage|"] = np.abs(rows["advantage"])
    shared = rows["|advantage|"] * (rows["lipschitz"] + rows["feature_norm"])
    for name, (a, b) in {
        "tightness": (rows["norm"], rows["bound"]),
        "shared_norm": (rows["norm"], shared),
        "shared_bound": (rows["bound"], shared),
    }.items():
        rows[name] = np.divide(a, b, out=np.full(len(b), np.nan), where=b > 0)
    return rows


def parts(rows: Rows, *names: str) -> Iterator[tuple[tuple[Any, ...], Rows]]:
    """The rows in parts, by what they have in these columns, in order of appearance."""
    found: dict[tuple[object, ...], list[int]] = {}
    for i, key in enumerate(zip(*(rows[name].tolist() for name in names), strict=True)):
        found.setdefault(key, []).append(i)
    for key, chosen in found.items():
        yield key, {name: column[chosen] for name, column in rows.items()}


def crossings(table: pa.Table) -> int:
    """Samples whose norm exceeds the bound by more than rounding can; the propositions say none."""
    rows = read(table)
    return int((~(rows["norm"] <= rows["bound"] * (1 + 1e-5) + 1e-20)).sum())


def of_the_paper(table: pa.Table) -> pa.Table:
    """The samples of the paper's losses, which centred HL-Gauss is not."""
    return table.filter(pc.is_in(table.column("loss"), pa.array([name for name in LOSSES if LOSSES[name].in_paper])))


class Finding(NamedTuple):
    """What the samples of a loss in one reading on one task say.

    An average over training gives each look the steps around it.
    """

    tightness: float
    """Median of norm / bound over all looks."""
    per_advantage: float
    """Mean bound / mean |A| over training: |A| is a factor of both propositions and differs with what was learnt."""
    last_per_advantage: float
    """The same at the last look alone, at the end of training."""
    variation: float
    """Standard deviation / mean of a run's mean bound / mean |A| over training; mean over seeds."""
    exponent: float
    """The p in norm / |A| (l + ‖f‖) ∝ σ^p while the trained policies are made sharper; NaN where they were not."""


def findings(table: pa.Table) -> dict[Series, Finding]:
    """What the samples of each series say, all seeds together."""
    series = dict(parts(read(table), "task", "loss", "reading", "swept"))
    return {
        (task, loss, reading): Finding(
            tightness=float(np.nanmedian(rows["tightness"])),
            per_advantage=_mean(rows, "bound") / _mean(rows, "|advantage|"),
            last_per_advantage=_mean(last := _last(rows), "bound") / _mean(last, "|advantage|"),
            variation=float(np.mean([_variation(run) for _, run in parts(rows, "seed")])),
            exponent=_exponent(series.get((task, loss, reading, True))),
        )
        for (task, loss, reading, swept), rows in series.items()
        if not swept
    }


def findings_by_seed(table: pa.Table) -> dict[Series, list[Finding]]:
    """What the samples of each series say, each seed's by themselves."""
    each = [findings(table.filter(pc.equal(table.column("seed"), seed))) for seed in np.unique(table.column("seed"))]
    return {series: [found[series] for found in each] for series in each[0]}


def _curve(rows: Rows, name: str) -> tuple[np.ndarray, np.ndarray]:
    """Mean at each look, and how much of training lies nearer to it than to the others."""
    steps, means = zip(*((step, point[name].mean()) for (step,), point in parts(rows, "step")), strict=True)
    ends = np.array([steps[0], *np.convolve(steps, [0.5, 0.5], "valid"), steps[-1]])
    return np.array(means), np.diff(ends) if len(steps) > 1 else np.ones(1)


def _mean(rows: Rows, name: str) -> float:
    means, share = _curve(rows, name)
    return float(np.average(means, weights=share))


def _last(rows: Rows) -> Rows:
    return {name: column[rows["step"] == rows["step"].max()] for name, column in rows.items()}


def _variation(run: Rows) -> float:
    bound, share = _curve(run, "bound")
    ratio = bound / _curve(run, "|advantage|")[0]
    mean = np.average(ratio, weights=share)
    return float(np.sqrt(np.average((ratio - mean) ** 2, weights=share)) / mean)


def _exponent(rows: Rows | None) -> float:
    if rows is None:
        return float("nan")
    points = [(part["sigma"].mean(), np.nanmean(part["shared_norm"])) for _, part in parts(rows, "factor")]
    sigma, norm = np.log([point for point in points if point[0] > 0]).T
    return float(np.polyfit(sigma, norm, 1)[0])
