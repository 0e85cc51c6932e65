"""The samples of `gradients` test Propositions 1 and 2, and show gradients' norms and their bounds (§4.3)."""

import functools
from collections.abc import Iterator, Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc
from jaxtyping import Float, Int

from galton.errors import require
from galton.losses import LOSSES
from galton.tasks import TASKS
from galton_experiments.analysis import Comparison, against, compare
from galton_experiments.page import Claim
from galton_experiments.sweep import columns
from studies.paper.gradients import READINGS, Sample
from studies.paper.measures import CLASSIFICATION
from studies.paper.prose import note, says
from studies.paper.trained import Trained
from studies.paper.verdicts import NOT_TRAINED, UNKNOWN, claim, summed_up

_WORDS: dict[str, Sequence[str]] = {"task": [*TASKS], "loss": [*LOSSES], "reading": ["", *READINGS]}
_COLUMNS = {"step": np.int64, "swept": np.bool_, "factor": np.float64, "seed": np.int64, "sample": np.int64}
Rows = dict[str, np.ndarray]
Series = tuple[str, str, str]
"""The key by which samples are sorted: task, loss and reading of the Gaussian's σ."""


def check(table: pa.Table) -> None:
    """Raise UsageError for a table that `gradients.collect` can't have made."""
    names = [*_WORDS, *_COLUMNS, *Sample._fields]
    columns.check_names(table, names)
    for name, kind in _COLUMNS.items():
        columns.numbers(table, name, kind)
    for name in Sample._fields:
        columns.numbers(table, name, np.float32)
    for name, known in _WORDS.items():
        for word in pc.unique(table.column(name)).to_pylist():
            require(word in known, f"its {name} has {word!r}; it must be one of {', '.join(map(repr, known))}")


def read(table: pa.Table) -> Rows:
    """The columns in float64, and quotients of them, sample by sample; NaN where what divides is 0.

    The quotients are the tightness, norm / bound, and of both sides, X being norm or bound: `X/|A|`, without the
    advantage that weights any loss, and `own X`, X / |A| (l + ‖f‖), without all that the two propositions share. The
    own bound is |a − μ| / σ² (or / σ) or Σ|q − π|, each summed over action dimensions.
    """
    rows = {name: np.asarray(table.column(name).to_numpy()) for name in table.column_names}
    rows |= {name: rows[name].astype(np.float64) for name in Sample._fields}
    advantage = np.abs(rows["advantage"])
    shared = advantage * (rows["lipschitz"] + rows["feature_norm"])
    for name, (a, b) in {
        "tightness": (rows["norm"], rows["bound"]),
        "norm/|A|": (rows["norm"], advantage),
        "bound/|A|": (rows["bound"], advantage),
        "own norm": (rows["norm"], shared),
        "own bound": (rows["bound"], shared),
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


def look_means(rows: Rows, name: str, by: str = "step") -> Float[np.ndarray, "seeds looks"]:
    """The mean over samples of a column for each seed and look (or other value of `by`), both in rising order."""
    seeds, seed = np.unique(rows["seed"], return_inverse=True)
    looks, look = np.unique(rows[by], return_inverse=True)
    known = ~np.isnan(rows[name])
    cell, shape = (seed * len(looks) + look)[known], (len(seeds), len(looks))
    total = np.bincount(cell, rows[name][known], minlength=len(seeds) * len(looks))
    count = np.bincount(cell, minlength=len(total))
    return np.divide(total, count, out=np.full(len(total), np.nan), where=count > 0).reshape(shape)


class Finding(NamedTuple):
    """A finding is what the samples of a loss in one reading on one task say, seed by seed.

    What is averaged over training is the mean of each look's samples, which stands for the steps around the look.
    """

    tightness: Float[np.ndarray, " seeds"]
    """Median of norm / bound over the samples of all looks."""
    bound: Float[np.ndarray, " seeds"]
    """bound / |A|, averaged over training."""
    own_bound: Float[np.ndarray, " seeds"]
    """The factor of the bound that the propositions do not share, averaged over training."""
    norm: Float[np.ndarray, " seeds"]
    """norm / |A|, averaged over training."""
    deviation: Float[np.ndarray, " seeds"]
    """Standard deviation of a look's mean bound / |A| over training."""
    variation: Float[np.ndarray, " seeds"]
    """The same divided by its mean: the coefficient of variation."""
    exponent: Float[np.ndarray, " seeds"]
    """The p in own norm ∝ σ^p while the trained policies are made sharper; NaN where they were not."""


def findings(table: pa.Table) -> dict[Series, Finding]:
    """Summarise the samples of each series."""
    series = dict(parts(read(table), "task", "loss", "reading", "swept"))
    found = {}
    for (task, loss, reading, swept), rows in series.items():
        if swept:
            continue
        bound, share = look_means(rows, "bound/|A|"), shares(np.unique(rows["step"]))
        mean = bound @ share
        deviation = np.sqrt((bound - mean[:, None]) ** 2 @ share)
        found[task, loss, reading] = Finding(
            tightness=np.array([np.nanmedian(run["tightness"]) for _, run in parts(rows, "seed")]),
            bound=mean,
            own_bound=look_means(rows, "own bound") @ share,
            norm=look_means(rows, "norm/|A|") @ share,
            deviation=deviation,
            variation=deviation / mean,
            exponent=_exponents(series.get((task, loss, reading, True)), len(mean)),
        )
    return found


def shares(steps: Int[np.ndarray, " looks"]) -> Float[np.ndarray, " looks"]:
    """The share of training that lies nearer to each look than to the others."""
    if len(steps) == 1:
        return np.ones(1)
    ends = np.concatenate([steps[:1], (steps[1:] + steps[:-1]) / 2, steps[-1:]])
    return np.diff(ends) / (steps[-1] - steps[0])


def smaller_from(
    ours: Float[np.ndarray, "seeds looks"], theirs: Float[np.ndarray, "seeds looks"], steps: Int[np.ndarray, " looks"]
) -> int | None:
    """The step of the look from which on the median over seeds is smaller than theirs to the end, if there is one."""
    not_smaller = np.flatnonzero(~(np.median(ours, axis=0) < np.median(theirs, axis=0)))
    first = not_smaller[-1] + 1 if len(not_smaller) else 0
    return int(steps[first]) if first < len(steps) else None


def _exponents(rows: Rows | None, n_seeds: int) -> Float[np.ndarray, " seeds"]:
    if rows is None:
        return np.full(n_seeds, np.nan)
    each = zip(look_means(rows, "sigma", "factor"), look_means(rows, "own norm", "factor"), strict=True)
    return np.array([np.polyfit(np.log(sigma[sigma > 0]), np.log(norm[sigma > 0]), 1)[0] for sigma, norm in each])


NAME = "propositions"
"""The name under which `Trained.tables` has the samples."""
LIKELIHOOD, PRINTED = READINGS
"""The readings of the Gaussian's σ: its log-likelihood's σ², which is trained with, and the σ that §4.3 prints."""
_FOR = {LIKELIHOOD: "the likelihood, (a − μ)² / 2σ²", PRINTED: "the loss as §4.3 prints it, (a − μ)² / 2σ"}
_OWN = {LIKELIHOOD: "|a − μ| / σ²", PRINTED: "|a − μ| / σ"}
"""The factor of the Gaussian's bound in the place of classification's Σ|q − π|."""
_SIGN = {LIKELIHOOD: "(σ²)", PRINTED: "(σ)"}


def bounds_hold(trained: Trained) -> Claim:
    """Judge what §4.3 proves: no sample's gradient exceeds the bound of Proposition 1 or 2."""
    rows = of_the_paper(trained.tables[NAME]) if NAME in trained.tables else None
    above = 0 if rows is None else crossings(rows)
    return Claim(
        *says("bounds_hold"),
        "" if rows is None else f"{above:,} of {rows.num_rows:,} above the bound",
        UNKNOWN if rows is None else "does not hold" if above else "holds",
        NOT_TRAINED if rows is None else note("bounds_hold"),
    )


@functools.lru_cache(maxsize=1)
def _findings(trained: Trained) -> Mapping[Series, Finding]:
    """Summarise the samples of the paper's losses; nothing where none were measured."""
    return findings(of_the_paper(trained.tables[NAME])) if NAME in trained.tables else {}


def against_gaussian(trained: Trained, reading: str, field: str) -> dict[str, Comparison]:
    """The logarithm of a field of the findings: the Gaussian's less classification's, by task and loss."""
    found = _findings(trained)
    return {
        f"{TASKS[task].title} {LOSSES[ours].label}": compare(
            np.log10(getattr(gaussian, field)), np.log10(getattr(found[task, ours, ""], field))
        )
        for (task, loss, its), gaussian in found.items()
        for ours in CLASSIFICATION
        if (loss, its) == ("gaussian", reading) and (task, ours, "") in found
    }


def norm_is_smaller(trained: Trained, reading: str) -> Claim:
    """Judge what §4.3 sets out to show: whose gradient has the smaller norm."""
    return claim(*says("norm_is_smaller", reading=_FOR[reading]), against_gaussian(trained, reading, "norm"))


def bound_is_smaller(trained: Trained, reading: str) -> Claim:
    """The last sentence of §4.3: whose bound is the smaller one."""
    own = against_gaussian(trained, reading, "own_bound")
    return claim(
        *says("bound_is_smaller", reading=_FOR[reading]),
        against_gaussian(trained, reading, "bound"),
        summed_up(f"Of the one factor that the bounds do not share, {_OWN[reading]} against Σ|q − π|", own),
        note("bound_is_smaller") * (reading == PRINTED),
        _from_when(trained, reading),
    )


def _from_when(trained: Trained, reading: str) -> str:
    """From which look on the median run's bound is the smaller one to the end, by task and loss."""
    if NAME not in trained.tables:
        return ""
    found = []
    for (task, swept), rows in parts(read(of_the_paper(trained.tables[NAME])), "task", "swept"):
        series = {key: look_means(part, "bound/|A|") for key, part in parts(rows, "loss", "reading")}
        for loss in CLASSIFICATION:
            if swept or (loss, "") not in series or ("gaussian", reading) not in series:
                continue
            step = smaller_from(series[loss, ""], series["gaussian", reading], np.unique(rows["step"]))
            when = "at no look" if step is None else f"from step {step:,}"
            found.append(f"{TASKS[task].title} {LOSSES[loss].label} {when}")
    early = "Early in training, while σ is large, §4.3 allows the contrary. "
    return f"{early}In the median run it is the smaller one to the end: {', '.join(found)}." * bool(found)


def bound_varies_less(trained: Trained, reading: str) -> Claim:
    """The last sentence of §4.3: whose bound moves less while it learns."""
    relative = against_gaussian(trained, reading, "variation")
    return claim(
        *says("bound_varies_less", reading=_FOR[reading]),
        against_gaussian(trained, reading, "deviation"),
        summed_up("Relative to its mean (coefficient of variation)", relative),
    )


def sigma_explodes(trained: Trained) -> Claim:
    """The factor 1/σ of §4.3, on trained policies that are made ever sharper."""
    return claim(
        *says("sigma_explodes"),
        {
            f"{TASKS[task].title} {_SIGN[reading]}": against(-found.exponent, 0.5)
            for (task, loss, reading), found in _findings(trained).items()
            if loss == "gaussian"
        },
        note("sigma_explodes"),
    )
