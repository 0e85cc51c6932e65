"""What the paper says of gradients (§4.3)."""

from collections.abc import Callable

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc

from galton.analysis.page import Claim
from galton.analysis.statistics import Interval, difference_interval, mean_interval
from galton.studies.base import Data
from galton.studies.claims.verdicts import NOT_TRAINED, UNKNOWN, listed, sorted_out, verdict
from galton.studies.propositions import Finding, crossings, findings
from galton.studies.sweeps import TASKS

_READINGS = {"sigma^2": "the likelihood's σ²", "sigma": "σ as printed"}


def bounds_hold(data: Data) -> Claim:
    """Propositions 1 and 2."""
    crossed = None if data.propositions is None else crossings(data.propositions)
    n = 0 if data.propositions is None else data.propositions.num_rows
    return Claim(
        "§4.3, Propositions 1 and 2",
        "The gradient's norm never exceeds the bound.",
        "both sides for each action sampled by networks in training; both readings of the Gaussian's σ",
        f"{crossed:,} of {n:,} samples above the bound" if n else "",
        UNKNOWN if crossed is None else "does not hold" if crossed else "holds",
        "The proofs need only the triangle inequality and l as the largest gradient of an output."
        if n
        else NOT_TRAINED,
        "propositions",
    )


def _by_seed(table: pa.Table, of: Callable[[Finding], float]) -> dict[tuple[str, str, str], np.ndarray]:
    """A finding by task, loss and reading, for each seed on its own."""
    seeds = np.unique(table.column("seed"))
    each = [findings(table.filter(pc.equal(table.column("seed"), seed))) for seed in seeds]
    return {key: np.array([of(found[key]) for found in each]) for key in each[0]}


def bound_is_smaller(data: Data) -> Claim:
    """§4.3, the last sentence."""
    gaps = _against_gaussian(data, lambda finding: float(np.log10(finding.per_advantage)))
    return Claim(
        "§4.3, §8",
        "Classification has a smaller bound on the gradient's norm.",
        "mean bound ÷ mean |A| over training: log₁₀(Gaussian ÷ HL-Gauss)",
        listed(gaps),
        verdict(gaps.values()),
        "At first Σ|q − π| is near 2 in each dimension and |a − μ| / σ near 0.8; only the likelihood's σ², once σ is "
        "small, turns that round."
        if gaps
        else NOT_TRAINED,
        "propositions",
    )


def bound_varies_less(data: Data) -> Claim:
    """§4.3, the last sentence."""
    gaps = _against_gaussian(data, lambda finding: float(np.log10(finding.variation_per_advantage)))
    return Claim(
        "§4.3",
        "Classification's bound varies less during learning.",
        "coefficient of variation of mean bound ÷ mean |A| over training: log₁₀(Gaussian ÷ HL-Gauss)",
        listed(gaps),
        verdict(gaps.values()),
        sorted_out(gaps),
        "propositions",
    )


def _against_gaussian(data: Data, of: Callable[[Finding], float]) -> dict[str, Interval]:
    """The Gaussian's less HL-Gauss's, by task and reading."""
    found = {} if data.propositions is None else _by_seed(data.propositions, of)
    return {
        f"{TASKS[task].title}, {_READINGS[reading]}": difference_interval(values, found[task, "hl-gauss", ""])
        for (task, loss, reading), values in found.items()
        if loss == "gaussian"
    }


def sigma_explodes(data: Data) -> Claim:
    """§4.3, the factor 1/σ."""
    found = {} if data.propositions is None else _by_seed(data.propositions, lambda finding: finding.exponent)
    gaps = {
        f"{TASKS[task].title}, {_READINGS[reading]}": mean_interval(-powers - 0.5)
        for (task, loss, reading), powers in found.items()
        if loss == "gaussian"
    }
    return Claim(
        "§4.3",
        "As σ → 0 the factor 1/σ makes the Gaussian's gradient explode.",
        "p − ½, where bound ÷ |A| (l + ‖f‖) ∝ σ⁻ᵖ as trained policies are made sharper; p = 0 is level",
        listed(gaps),
        verdict(gaps.values()),
        "The action's distance from the mean shrinks with σ, so one power of σ cancels: with the printed loss nothing "
        "grows, with the likelihood's σ² it grows like 1/σ."
        if gaps
        else NOT_TRAINED,
        "propositions",
    )
