"""What the paper says of gradients (§4.3)."""

from collections.abc import Callable

import numpy as np
import pyarrow.compute as pc

from galton.analysis.page import Claim
from galton.analysis.statistics import Interval, difference_interval, mean_interval
from galton.losses import LOSSES
from galton.studies.base import Data
from galton.studies.claims.verdicts import NOT_TRAINED, UNKNOWN, listed, sorted_out, verdict
from galton.studies.measures import CLASSIFICATION
from galton.studies.propositions import Finding, crossings, findings, of_the_paper
from galton.tasks import TASKS

_READINGS = {"sigma^2": "(σ²)", "sigma": "(σ)"}
"""What divides the Gaussian's squared error: the variance, as in the likelihood, or σ, as §4.3 prints it."""


def bounds_hold(data: Data) -> Claim:
    """Propositions 1 and 2."""
    rows = None if data.propositions is None else of_the_paper(data.propositions)
    return Claim(
        "§4.3, Propositions 1 and 2",
        "The gradient's norm never exceeds the bound.",
        "both sides for each action sampled by networks in training, and by trained ones made sharper; both readings "
        "of the Gaussian's σ",
        "" if rows is None else f"{crossings(rows):,} of {rows.num_rows:,} above the bound",
        UNKNOWN if rows is None else "does not hold" if crossings(rows) else "holds",
        NOT_TRAINED
        if rows is None
        else "The proofs need only the triangle inequality and l as the largest gradient of an output.",
        "propositions",
    )


def _by_seed(data: Data, of: Callable[[Finding], float]) -> dict[tuple[str, str, str], np.ndarray]:
    """A finding by task, loss and reading, for each seed on its own."""
    if data.propositions is None:
        return {}
    table = of_the_paper(data.propositions)
    each = [findings(table.filter(pc.equal(table.column("seed"), seed))) for seed in np.unique(table.column("seed"))]
    return {key: np.array([of(found[key]) for found in each]) for key in each[0]}


def _against_gaussian(data: Data, of: Callable[[Finding], float]) -> dict[str, Interval]:
    """The Gaussian's less classification's, by task, loss and reading."""
    found = _by_seed(data, of)
    return {
        f"{TASKS[task].title} {LOSSES[ours].label} {_READINGS[reading]}": difference_interval(
            values, found[task, ours, ""]
        )
        for (task, loss, reading), values in found.items()
        for ours in CLASSIFICATION
        if loss == "gaussian" and (task, ours, "") in found
    }


def bound_is_smaller(data: Data) -> Claim:
    """§4.3, the last sentence."""
    gaps = _against_gaussian(data, lambda finding: float(np.log10(finding.per_advantage)))
    last = _against_gaussian(data, lambda finding: float(np.log10(finding.last_per_advantage)))
    smaller = [name for name, gap in last.items() if gap.low > 0]
    return Claim(
        "§4.3, §8",
        "Classification has a smaller bound on the gradient's norm.",
        "mean bound ÷ mean |A|, averaged over the steps of training: log₁₀(Gaussian ÷ classification), the "
        "Gaussian's loss divided by σ² as in the likelihood or by σ as printed",
        listed(gaps),
        verdict(gaps.values()),
        sorted_out(gaps, f"In the end as the paper says: {', '.join(smaller) or 'none'}."),
        "propositions",
    )


def bound_varies_less(data: Data) -> Claim:
    """§4.3, the last sentence."""
    gaps = _against_gaussian(data, lambda finding: float(np.log10(finding.variation)))
    return Claim(
        "§4.3",
        "Classification's bound varies less during learning.",
        "coefficient of variation, over the steps of training, of mean bound ÷ mean |A|: log₁₀(Gaussian ÷ "
        "classification), with σ² or σ",
        listed(gaps),
        verdict(gaps.values()),
        sorted_out(gaps),
        "propositions",
    )


def sigma_explodes(data: Data) -> Claim:
    """§4.3, the factor 1/σ."""
    gaps = {
        f"{TASKS[task].title} {_READINGS[reading]}": mean_interval(-powers - 0.5)
        for (task, loss, reading), powers in _by_seed(data, lambda finding: finding.exponent).items()
        if loss == "gaussian"
    }
    return Claim(
        "§4.3",
        "As σ → 0 the factor 1/σ makes the Gaussian's gradient explode.",
        "p − ½, where norm ÷ |A| (l + ‖f‖) ∝ σ⁻ᵖ as trained policies are made sharper; ½ divides level (0) from 1/σ "
        "(1)",
        listed(gaps),
        verdict(gaps.values()),
        sorted_out(gaps, "The action's distance from the mean shrinks with σ, so one power of σ cancels."),
        "propositions",
    )
