"""A policy's deterministic action in float64, with numpy alone: what float32 rounds, here and in ONNX Runtime."""

from typing import NamedTuple

import numpy as np
from scipy.interpolate import BSpline
from scipy.stats import norm


class Exact(NamedTuple):
    action: np.ndarray
    size: np.ndarray
    """[n, d]: the sum of the absolute values of what is added up last on the way to the action, in half-widths or
    logits; at least the distance of the box's far end from 0, in half-widths."""
    choices: np.ndarray
    """[n, d, k]: for a rule that picks a bin, by how much each is not the one to pick; else nothing."""
    centers: np.ndarray


def exactly(model, states, taken=None):
    """The action for each state, and how much rounding may change it.

    Where a dimension depends on the ones before it, these are the ones of the action that was taken.
    """
    params, settings = model.learner.params, model.settings
    x, weight = _features(model, states.astype(np.float64))
    layer = {name: np.asarray(value, np.float64) for name, value in params["actor"][-1].items()}
    outputs, size = x @ layer["kernel"] + layer["bias"], weight @ abs(layer["kernel"]) + abs(layer["bias"])
    low, high = (np.asarray(bound, np.float64) for bound in (model.agent.low, model.agent.high))
    center, half = (high + low) / 2, (high - low) / 2
    least = np.maximum(abs(low), abs(high)) / half
    if settings["policy"] == "squashed-gaussian":
        return Exact(center + half * np.tanh(outputs), np.maximum(size, least), np.zeros(0), np.zeros(0))
    if settings["policy"] == "beta":
        shapes = 1 + np.logaddexp(0, outputs.reshape(len(x), -1, 2))
        size = np.maximum(size.reshape(shapes.shape).max(-1), least)
        return Exact(low + 2 * half * shapes[..., 0] / shapes.sum(-1), size, np.zeros(0), np.zeros(0))
    if settings["policy"] == "spline":
        cells = 64
        x = np.linspace(0, 1, cells + 1)
        n = settings["n_splines"]
        knots = np.concatenate([np.zeros(3), np.linspace(0, 1, n - 2), np.ones(3)])
        basis = BSpline(knots, np.eye(n), 3)(x)
        logits, sizes = (of.reshape(len(outputs), -1, n) @ basis.T for of in (outputs, size))
        centers = low[:, None] + (high - low)[:, None] * x
        return _chosen("mode", logits, np.maximum(sizes.max(-1), least), centers)
    if settings["loss"] == "gaussian":
        in_box = settings["box_units"] == 1
        mean, size = (center + half * outputs, size) if in_box else (outputs, size / half)
        return Exact(np.clip(mean, low, high), np.maximum(size, least), np.zeros(0), np.zeros(0))
    d, k = len(low), settings["n_bins"]
    centers = low[:, None] + (high - low)[:, None] * (np.arange(k) + 0.5) / k
    if settings["policy"] in ("discretised-gaussian", "anchored"):
        parts, sizes = (of.reshape(len(x), d, -1) for of in (outputs, size))
        in_box = settings["box_units"] == 1
        std = np.exp(np.maximum(np.asarray(params["log_std"], np.float64), settings["log_std_min"]))[:, None]
        mean = parts[..., -1:] * (half[:, None] if in_box else 1) + (center[:, None] if in_box else 0)
        z = (centers - mean) / (std * (half[:, None] if in_box else 1))
        logits = -0.5 * z**2
        size = (abs(z) * (sizes[..., -1:] + abs(z) * std) / std).max(-1)  # of the slope, and of z itself
        if settings["policy"] == "anchored":
            logits = logits + settings["residual_scale"] * parts[..., :-1]
            size = size + settings["residual_scale"] * sizes[..., :-1].max(-1)
        return _chosen(settings["deterministic_action"], logits, np.maximum(size, least), centers)
    rule = settings["deterministic_action"]
    if settings["policy"] == "joint":
        cells = np.stack(np.meshgrid(*centers, indexing="ij")).reshape(d, -1)
        return _chosen(rule, outputs[:, None], np.maximum(size.max(-1, keepdims=True), least), cells)
    if settings["policy"] == "autoregressive":
        logits, hidden = outputs[:, : d * k].reshape(-1, d, k).copy(), outputs[:, d * k :]
        size = np.repeat(size.max(-1, keepdims=True), d, 1)
        embedding, readout = (np.asarray(params[name], np.float64) for name in ("embedding", "readout"))
        for i in range(1, d):
            index = np.clip((taken[:, i - 1] - low[i - 1]) / (high - low)[i - 1] * k, 0, k - 1).astype(int)
            hidden = hidden + embedding[i - 1][index]
            logits[:, i] += np.tanh(hidden) @ readout[i - 1]
            size[:, i] += abs(readout[i - 1]).sum(0).max() * (1 + size[:, 0])
        return _chosen(rule, logits, np.maximum(size, least), centers)
    logits, size = outputs.reshape(-1, d, k), size.reshape(-1, d, k).max(-1)
    if settings["policy"] == "ordinal":
        size = abs(logits).sum(-1) + size
        logits = logits.cumsum(-1)
    if settings["policy"] == "smoothed":
        edges = np.arange(k + 1) - np.arange(k)[:, None] - 0.5
        kernel = np.diff(norm.cdf(edges / float(settings["eta"])))
        logits = logits @ (kernel / kernel.sum(1, keepdims=True)).T
    return _chosen(settings["deterministic_action"], logits, np.maximum(size, least), centers)


def _chosen(rule, logits, size, centers):
    probs = np.exp(logits - logits.max(-1, keepdims=True))
    probs /= probs.sum(-1, keepdims=True)
    if rule == "mean":
        return Exact((probs * centers).sum(-1), size, np.zeros(0), np.zeros(0))
    if rule == "mode":
        choices = logits.max(-1, keepdims=True) - logits
    else:
        above = probs.cumsum(-1)
        choices = np.maximum(np.maximum(0.5 - above, above - probs - 0.5), 0)
    index = choices.argmin(-1)
    return Exact(centers[np.arange(len(centers)), index], size, choices, centers)


def _features(model, x):
    """What the last layer sees, and its absolute values."""
    moments, origin = model.learner.normalizer.observation, model.learner.normalizer.origin
    if moments:
        mean, variance = (np.asarray(value, np.float64) for value in moments[:2])
        x = np.clip((x - np.asarray(origin, np.float64) - mean) / np.sqrt(variance + 1e-8), -10, 10)
    for layer in model.learner.params["actor"][:-1]:
        x = np.tanh(x @ np.asarray(layer["kernel"], np.float64) + np.asarray(layer["bias"], np.float64))
    return x, abs(x)
