"""ONNX computes each policy's deterministic action by a function of the network's outputs, a line in ACTIONS.

Each says in a graph what the `deterministic_action` of its distribution says in JAX.
"""

import functools
from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np

from galton.bins import Bins, GridBins, UnevenBins
from galton.deploy.graph import Graph
from galton.policies import (
    AnchoredPolicy,
    AutoregressivePolicy,
    BetaPolicy,
    BinnedPolicy,
    DiscretisedGaussianPolicy,
    GaussianHead,
    JointPolicy,
    OrdinalPolicy,
    SmoothedPolicy,
    SplinePolicy,
    SquashedGaussianPolicy,
)
from galton.policies.gaussian import units_of
from galton.policies.histogram import NOWHERE
from galton.policies.mixed import MixedPolicy
from galton.policies.spline import CELLS, LOG_WEIGHT, MEANS, basis, nodes

OF_CHOICES = "Of a choice, the index of its most likely value; of equally likely ones, the lowest."


class Chosen(NamedTuple):
    """The action that a policy takes without exploration."""

    action: str
    """The name of its step in the graph, `[batch, d]` in the environment's units; the bounds are put on afterwards."""
    rule: str
    """The rule that chooses this action from its distribution, in one word."""
    meaning: str
    """The same in a sentence, for the contract."""


MEANINGS = {
    "mode": "The center of the most likely bin of each action dimension; of equally likely ones, the lowest.",
    "mean": "The mean of the bin centers, weighted by their probabilities, in each action dimension.",
    "median": "The center of the first bin of each action dimension below whose upper edge more than half of the "
    "probability lies.",
}
"""The meaning of each rule by which a softmax policy chooses its action."""
MEAN_OF_GAUSSIAN = "The mean of the Gaussian, moved to the nearest point of the action box."
OF_GAUSSIANS = {
    "clipped-gaussian": ("median", "The median: the mean of the Gaussian, clipped into the action box."),
    "truncated-gaussian": ("mode", "The mode: the point of the action box nearest to the Gaussian's mean."),
    "squashed-gaussian": ("median", "The median: the Gaussian's mean through tanh, which maps it into the action box."),
}
"""The rule and its meaning of those that choose by a Gaussian's mean, and do not call it the mean."""


def gaussian(
    graph: Graph, outputs: str, policy: GaussianHead, rule: str = "mean", meaning: str = MEAN_OF_GAUSSIAN
) -> Chosen:
    """The mean: the outputs or their tanh; in units of the box, its center plus as many half-widths."""
    if policy.state_dependent_std:
        outputs = graph.add("Gather", outputs, np.arange(len(policy.low)), axis=1)
    has_tanh = isinstance(policy, SquashedGaussianPolicy) or getattr(policy, "tanh_mean", False)
    outputs = graph.add("Tanh", outputs) if has_tanh else outputs
    if policy.box_units or has_tanh:
        scaled = graph.add("Mul", outputs, (policy.high - policy.low) / 2)
        outputs = graph.add("Add", scaled, (policy.high + policy.low) / 2)
    return Chosen(outputs, rule, meaning)


def beta(graph: Graph, outputs: str, policy: BetaPolicy) -> Chosen:
    """The mean: α / (α + β) of the box, where α and β are 1 + softplus of the outputs."""
    low, size = policy.low, policy.high - policy.low
    pairs = graph.add("Softplus", graph.add("Reshape", outputs, np.array([0, len(low), 2])))
    shapes = graph.add("Add", pairs, 1.0)
    share = graph.add("Div", shapes, graph.add("ReduceSum", shapes, np.array([-1]), keepdims=1))
    alpha = graph.add("Gather", share, np.array(0), axis=2)
    action = graph.add("Add", graph.add("Mul", alpha, size), low)
    return Chosen(action, "mean", "The mean of the Beta distribution on the action box.")


def histogram(graph: Graph, outputs: str, policy: BinnedPolicy, name: str = "logits") -> Chosen:
    """The mode, the mean or the median of the bins, whose logits are the outputs."""
    bins, rule = policy.bins, policy.choices.deterministic_action
    if isinstance(bins, UnevenBins):
        outputs = _padded(graph, outputs, bins)
    rows = 1 if isinstance(bins, GridBins) else len(bins.centers)
    logits = graph.add("Reshape", outputs, np.array([0, rows, bins.n_bins]), name=name)
    action = _by_rule(graph, logits, bins, rule)
    if rule == "mean" and policy.choices.is_masked:
        action = _nearest_allowed(graph, logits, bins, action)
    if not isinstance(bins, UnevenBins) or not bins.is_choice.any():
        return Chosen(action, rule, MEANINGS[rule])
    if rule != "mode" and not bins.is_choice.all():
        numbers, mode = (1.0 - bins.is_choice, _by_rule(graph, logits, bins, "mode"))
        action = graph.add("Add", graph.add("Mul", action, numbers), graph.add("Mul", mode, 1.0 - numbers))
    elif rule != "mode":
        action, rule = _by_rule(graph, logits, bins, "mode"), "mode"
    return Chosen(action, rule, f"{MEANINGS[rule]} {OF_CHOICES}" if not bins.is_choice.all() else OF_CHOICES)


def joint(graph: Graph, outputs: str, policy: JointPolicy) -> Chosen:
    """The mode or the mean of the cells, whose logits are the outputs."""
    chosen = histogram(graph, outputs, policy)
    mode = "The center of the most likely cell of the grid; of equally likely ones, the first."
    return chosen._replace(meaning=mode) if chosen.rule == "mode" else chosen


def autoregressive(graph: Graph, outputs: str, policy: AutoregressivePolicy) -> Chosen:
    """As the softmax policy chooses, in one dimension after the other."""
    (d, k), rule, entries = policy.bins.centers.shape, policy.deterministic_action, list[str]()
    hidden = graph.add("Gather", outputs, np.arange(d * k, policy.n_outputs), axis=1)
    for i in range(d):
        bins = policy.bins.only(i)
        logits = graph.add("Gather", outputs, np.arange(i * k, (i + 1) * k), axis=1)
        if i:
            more = graph.add("MatMul", graph.add("Tanh", hidden), np.asarray(graph.params["readout"][i - 1]))
            logits = graph.add("Add", logits, more)
        entries.append(_by_rule(graph, graph.add("Reshape", logits, np.array([0, 1, k])), bins, rule))
        if i < d - 1:
            passed = graph.add("Cast", graph.add("Less", entries[-1], bins.edges[0, 1:-1]), to=1)
            index = graph.add("Sub", k - 1.0, graph.add("ReduceSum", passed, np.array([-1]), keepdims=0))
            rows = graph.add("Gather", np.asarray(graph.params["embedding"][i]), graph.add("Cast", index, to=7), axis=0)
            hidden = graph.add("Add", hidden, rows)
    return Chosen(graph.add("Concat", *entries, axis=1), rule, f"After the dimensions before it: {MEANINGS[rule]}")


def mixed(graph: Graph, outputs: str, policy: MixedPolicy, numbers: Callable[[Graph, str, Any], Chosen]) -> Chosen:
    """The numbers as their own head chooses, and of each choice the most likely value."""
    box, n = policy.box, policy.sizes[0]
    assert box is not None
    logits = graph.add("Gather", outputs, np.arange(n, policy.n_outputs), axis=1)
    chosen = histogram(graph, logits, policy.of_choices, "logits_of_choices")
    if not box.numbers:
        return chosen
    own = numbers(graph, graph.add("Gather", outputs, np.arange(n), axis=1), policy.numbers)
    both = graph.add("Concat", own.action, chosen.action, axis=1)
    order = np.argsort(np.array([*box.numbers, *box.choices]))
    action = graph.add("Gather", both, order, axis=1)
    return own._replace(action=action, meaning=f"{own.meaning} {OF_CHOICES}")


def _by_rule(graph: Graph, logits: str, bins: Bins, rule: str) -> str:
    if rule == "mean":
        weighted = graph.add("Mul", graph.add("Softmax", logits, axis=-1), bins.centers)
        return graph.add("ReduceSum", weighted, np.array([-1]), keepdims=0)
    index = graph.add("ArgMax", logits, axis=-1, keepdims=0) if rule == "mode" else _median(graph, logits)
    first = np.arange(len(bins.centers)) * bins.n_bins
    return graph.add("Gather", bins.centers.ravel(), graph.add("Add", index, first))


def _nearest_allowed(graph: Graph, logits: str, bins: Bins, action: str) -> str:
    """The action where its bin is allowed, and else the nearest center of one that is."""
    d, k = bins.centers.shape
    allowed = graph.add("Cast", graph.add("Greater", logits, NOWHERE / 2), to=1)
    wide = graph.add("Reshape", action, np.array([0, d, 1]))
    above = graph.add("Cast", graph.add("GreaterOrEqual", wide, bins.edges[:, :-1]), to=1)
    below = graph.add("Cast", graph.add("Less", wide, bins.edges[:, 1:]), to=1)
    here = graph.add("Mul", allowed, graph.add("Mul", above, below))
    inside = graph.add("ReduceSum", here, np.array([-1]), keepdims=0)
    away = graph.add("Mul", graph.add("Sub", 1.0, allowed), -NOWHERE)
    distance = graph.add("Add", graph.add("Abs", graph.add("Sub", wide, bins.centers)), away)
    index = graph.add("Add", graph.add("ArgMin", distance, axis=-1, keepdims=0), np.arange(d) * k)
    near = graph.add("Mul", graph.add("Gather", bins.centers.ravel(), index), graph.add("Sub", 1.0, inside))
    return graph.add("Add", graph.add("Mul", action, inside), near)


def _padded(graph: Graph, outputs: str, bins: UnevenBins) -> str:
    """The logits of each dimension, filled up to as many as the largest has."""
    places = np.cumsum(bins.valid.ravel()) - 1
    spread = graph.add("Gather", outputs, np.where(bins.valid.ravel(), places, 0), axis=1)
    kept = graph.add("Mul", spread, bins.valid.ravel().astype(np.float32))
    return graph.add("Add", kept, np.where(bins.valid.ravel(), 0.0, NOWHERE))


def discretised(graph: Graph, outputs: str, policy: DiscretisedGaussianPolicy) -> Chosen:
    """As the softmax policy chooses, from a Gaussian's logits around the outputs."""
    return histogram(graph, _gaussian_logits(graph, outputs, policy), policy)


def anchored(graph: Graph, outputs: str, policy: AnchoredPolicy) -> Chosen:
    """As the softmax policy chooses, from a Gaussian's logits plus the residuals."""
    d, k = policy.bins.centers.shape
    parts = graph.add("Reshape", outputs, np.array([0, d, k + 1]))
    residuals = graph.add("Gather", parts, np.arange(k), axis=2)
    mean = graph.add("Gather", parts, np.array(k), axis=2)
    free = graph.add("Mul", residuals, np.asarray(policy.residual_scale))
    return histogram(graph, graph.add("Add", _gaussian_logits(graph, mean, policy), free), policy)


def _gaussian_logits(graph: Graph, mean: str, policy: DiscretisedGaussianPolicy) -> str:
    """The logits −(c − μ)² / 2σ² of each bin, `[batch, d, k]`, of a policy whose σ is its first one."""
    d = len(policy.bins.centers)
    std = np.exp(np.maximum(policy.log_std_init, policy.log_std_min)) * np.ones(d)
    shift, scale = (np.reshape(np.asarray(x), (-1, 1)) for x in units_of(policy, policy.box_units))
    centers = (policy.bins.centers - shift) / scale
    apart = graph.add("Sub", graph.add("Reshape", mean, np.array([0, d, 1])), centers)
    z = graph.add("Div", apart, std[:, None])
    return graph.add("Mul", graph.add("Mul", z, z), -0.5)


def ordinal(graph: Graph, outputs: str, policy: OrdinalPolicy) -> Chosen:
    """As the softmax policy chooses, from the cumulative sums of the outputs of each dimension."""
    steps = graph.add("Reshape", outputs, np.array([0, *policy.bins.centers.shape]))
    return histogram(graph, graph.add("CumSum", steps, np.array(-1)), policy)


def smoothed(graph: Graph, outputs: str, policy: SmoothedPolicy) -> Chosen:
    """As the softmax policy chooses, from moving averages of the outputs of each dimension."""
    shape = policy.bins.centers.shape
    z = graph.add("Reshape", outputs, np.array([0, *shape]))
    logits = graph.add("MatMul", z, np.asarray(policy.kernel()).T)
    first = np.broadcast_to(np.asarray(policy.first_logits()), policy.n_outputs).reshape(shape)
    return histogram(graph, graph.add("Add", logits, first), policy)


def spline(graph: Graph, outputs: str, policy: SplinePolicy) -> Chosen:
    """The node where the density is largest, or the mean, from the log-density at each node."""
    d, cell = len(policy.low), (policy.high - policy.low)[:, None] / CELLS
    coefficients = graph.add("Reshape", outputs, np.array([0, d, policy.n_splines]))
    logits = graph.add("MatMul", coefficients, basis(policy.n_splines).T)
    if policy.deterministic_action == "mean":
        shares = graph.add("Softmax", graph.add("Add", logits, LOG_WEIGHT), axis=-1)
        weighted = graph.add("Mul", shares, policy.low[:, None] + cell * MEANS)
        action = graph.add("ReduceSum", weighted, np.array([-1]), keepdims=0)
        return Chosen(action, "mean", "The mean of the density.")
    largest = graph.add("ArgMax", logits, axis=-1, keepdims=0)
    index = graph.add("Add", largest, np.arange(d) * (CELLS + 1))
    action = graph.add("Gather", nodes(policy.low, policy.high).ravel(), index)
    return Chosen(action, "mode", "The point of a grid of 65 in each action dimension where the density is largest.")


def _median(graph: Graph, logits: str) -> str:
    """The bin of each dimension where the cumulative distribution passes one half, `[batch, d]`."""
    largest = graph.add("ReduceMax", logits, axes=[-1], keepdims=1)
    weights = graph.add("Exp", graph.add("Sub", logits, largest))
    half = graph.add("Mul", graph.add("ReduceSum", weights, np.array([-1]), keepdims=1), 0.5)
    passed = graph.add("Greater", graph.add("CumSum", weights, np.array(-1)), half)
    return graph.add("ArgMax", graph.add("Cast", passed, to=1), axis=-1, keepdims=0)  # the first that is true


ACTIONS: dict[str, Callable[[Graph, str, Any], Chosen]] = {
    "gaussian": gaussian,
    "histogram": histogram,
    "ordinal": ordinal,
    "smoothed": smoothed,
    "discretised-gaussian": discretised,
    "anchored": anchored,
    **{name: functools.partial(gaussian, rule=rule, meaning=told) for name, (rule, told) in OF_GAUSSIANS.items()},
    "beta": beta,
    "rpo": gaussian,
    "spline": spline,
    "full-gaussian": gaussian,
    "joint": joint,
    "autoregressive": autoregressive,
}
"""By the names in POLICIES: (graph, the outputs' name in it `[batch, n_outputs]`, policy). Where the policy learns
log σ, its `log_std_init` is what was learnt."""
