"""The ONNX file does what `predict(deterministic=True)` does, on 10,000 states, small and large.

They agree to 1e-6 of the half-width of the action box. float32 rounds in proportion to the numbers that are added up:
where a linear network sees observations as they are, or outputs have grown large, the sum of the numbers' sizes takes
the place of 1. Against float64 the file may be twice as far off as `predict` is at most, where a hidden layer without
normalisation sees large observations: neither keeps to the sum of the last layer's sizes there. Two bins that are
equally good to within as much are a tie, of which either may be taken.
"""

import copy
import functools
import itertools

import numpy as np
import onnxruntime
import pytest

from galton import POLICIES
from galton.deploy.decision import decide
from galton.deploy.policy_files import encode

from .drifting import states, trained
from .exactly import exactly

pytestmark = pytest.mark.slow
N = 10_000
RULES = ("mode", "mean", "median")
IN_BOX = ("squashed-gaussian", "beta")


def ways(policy):
    """The rules of a policy over bins; of a density, both of box_units unless it is in units of its box anyway."""
    if policy == "joint":
        return RULES[:2]
    return RULES if POLICIES[policy].family == "histogram" else (1.0,) if policy in IN_BOX else (0.0, 1.0)


WAYS = [(policy, way) for policy in POLICIES for way in ways(policy)]
CASES = [(*way, *rest) for way, rest in itertools.product(WAYS, [("ppo", True), ("a2c", False)])]
"""What trained a policy is no part of its file, so that each algorithm has a half of the cases."""
SMALL, LARGE = ((), 1), ((64, 64), 6)
"""Hidden layers and action dimensions."""


@functools.cache
def model_of(policy, algorithm, normalize, net_arch, d, box_units):
    more = {"box_units": box_units, "normalize_observation": normalize, "net_arch": net_arch}
    return trained(policy, algorithm, d, **more)


def acting_by(model, rule):
    other = copy.copy(model)
    other.agent = model.agent.acting_by(rule)
    return other


def check(policy, way, algorithm, normalize, net_arch, d):
    units, rule = (way, "mode") if isinstance(way, float) else (0.0, way)
    model = acting_by(model_of(policy, algorithm, normalize, net_arch, d, units), rule)
    return compare(model, small=bool(normalize or net_arch))


def compare(model, small):
    """Check that ONNX Runtime acts as `predict`; `small` is whether the numbers on the way to the action are.

    How far they are apart, in half-widths of the box, but for bins: of those a tie may take either.
    """
    observations, space = states(N, model.observations.size), model.action_space
    session = onnxruntime.InferenceSession(encode(decide(model)))
    (found,) = session.run(["action"], {"observation": observations})
    expected, _ = model.predict(observations, deterministic=True)
    assert found.shape == expected.shape == (N, *space.shape)
    assert found.dtype == np.float32
    assert ((found >= space.low) & (found <= space.high)).all()
    exact, half = exactly(model, observations, expected), (space.high - space.low) / 2
    of_file = exactly(model, observations, found) if model.settings["policy"] == "autoregressive" else exact
    sizes = 1e-6 * np.maximum(exact.size, 1)
    if not exact.choices.size:
        assert (abs(found - expected) <= (1e-6 if small else sizes) * half).all()
        # Where float32 itself is further from float64, as in a hidden layer that saw large numbers, so is `predict`.
        of_predict = abs(expected - exact.action).max()
        assert (abs(found - of_file.action) <= np.maximum(sizes * half, 2 * of_predict)).all()
        return float((abs(found - expected) / half).max())
    for action, own in ((found, of_file), (expected, exact)):  # either took a bin that is right, to within rounding
        apart = abs(action[..., None] - own.centers)
        bins = (apart.sum(-2, keepdims=True) if own.choices.shape[-2] == 1 else apart).argmin(-1)
        assert (np.take_along_axis(own.choices, bins[..., None], -1)[..., 0] <= sizes).all()
    assert np.mean(found == expected) > 0.999
    return 0.0


@pytest.mark.parametrize(("policy", "way", "algorithm", "normalize"), CASES)
def test_the_file_does_what_predict_does(policy, way, algorithm, normalize, trust):
    apart = check(policy, way, algorithm, normalize, *(LARGE if normalize else SMALL))
    promise = "An exported policy acts under ONNX Runtime as `predict` does, where observations are normalised."
    if normalize:
        unit = "half-widths of the box apart, on 10,000 states for each policy and rule"
        trust("onnx", promise, topic="deployed", figure=apart, unit=unit, at_most=1e-6)


@pytest.mark.parametrize("case", CASES, ids=lambda case: "-".join(map(str, case)))
def test_the_file_does_what_predict_does_with_other_layers(case):
    check(*case, *(SMALL if case[-1] else LARGE))


@pytest.mark.parametrize(("policy", "way"), WAYS)
def test_large_outputs_are_rounded_as_predict_rounds_them(policy, way):
    units, rule = (way, "mode") if isinstance(way, float) else (0.0, way)
    model = acting_by(trained(policy, "ppo", 6, box_units=units, normalize_observation=True), rule)
    parameters = model.get_parameters()
    parameters["actor"][-1] = {name: 25 * array for name, array in parameters["actor"][-1].items()}
    model.set_parameters(parameters)
    compare(model, small=False)
