"""What §4.3 says of the gradients' norms and their bounds, judged by the samples of `gradients`."""

import functools
from collections.abc import Mapping

import numpy as np

from galton.losses import LOSSES
from galton.tasks import TASKS
from galton_experiments.analysis import Comparison, against, compare
from galton_experiments.page import Claim
from studies.paper.bounds import (
    Finding,
    Series,
    crossings,
    findings,
    look_means,
    of_the_paper,
    parts,
    read,
    smaller_from,
)
from studies.paper.gradients import READINGS
from studies.paper.measures import CLASSIFICATION
from studies.paper.prose import says
from studies.paper.trained import Trained
from studies.paper.verdicts import NOT_TRAINED, UNKNOWN, claim, summed_up

NAME = "propositions"
"""The name under which `Trained.tables` has the samples."""
LIKELIHOOD, PRINTED = READINGS
"""The readings of the Gaussian's σ: its log-likelihood's σ², which is trained with, and the σ that §4.3 prints."""
_FOR = {LIKELIHOOD: "the likelihood, (a − μ)² / 2σ²", PRINTED: "the loss as §4.3 prints it, (a − μ)² / 2σ"}
_OWN = {LIKELIHOOD: "|a − μ| / σ²", PRINTED: "|a − μ| / σ"}
"""What the Gaussian's bound has where classification's has Σ|q − π|."""
_MEASURED = "sample by sample, averaged over the steps of training: log₁₀(Gaussian ÷ classification), a number a seed"
_SIGN = {LIKELIHOOD: "(σ²)", PRINTED: "(σ)"}


def bounds_hold(trained: Trained) -> Claim:
    """What §4.3 proves: no sample's gradient exceeds the bound of Proposition 1 or 2."""
    rows = of_the_paper(trained.tables[NAME]) if NAME in trained.tables else None
    above = 0 if rows is None else crossings(rows)
    return Claim(
        *says("bounds_hold"),
        "" if rows is None else f"{above:,} of {rows.num_rows:,} above the bound",
        UNKNOWN if rows is None else "does not hold" if above else "holds",
        NOT_TRAINED
        if rows is None
        else "The proofs need only the triangle inequality and l as the largest gradient of an output.",
    )


@functools.lru_cache(maxsize=1)
def _findings(trained: Trained) -> Mapping[Series, Finding]:
    """What the samples say of the paper's losses; nothing where none were measured."""
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
    """What §4.3 sets out to show: whose gradient has the smaller norm."""
    return claim(
        *says("norm_is_smaller", reading=_FOR[reading]),
        against_gaussian(trained, reading, "norm"),
    )


def bound_is_smaller(trained: Trained, reading: str) -> Claim:
    """The last sentence of §4.3: whose bound is the smaller one."""
    own = against_gaussian(trained, reading, "own_bound")
    return claim(
        *says("bound_is_smaller", reading=_FOR[reading]),
        against_gaussian(trained, reading, "bound"),
        summed_up(f"Of the one factor that the bounds do not share, {_OWN[reading]} against Σ|q − π|", own),
        "|a − μ| / σ averages √(2/π) an action dimension, whatever σ is: as printed nothing grows."
        * (reading == PRINTED),
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
        "The action's distance from the mean shrinks with σ, so one power of σ cancels.",
    )
