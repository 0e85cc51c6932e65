"""Each policy's action in ONNX is its distribution's, from the network's outputs on."""

import jax
import numpy as np
import onnxruntime
import pytest

from galton.deploy.actions import ACTIONS
from galton.deploy.decision import ACTION, OBSERVATION, Decision
from galton.deploy.graph import Graph
from galton.deploy.policy_files import encode
from galton.policies import POLICIES, GaussianHead

from ..agents import agent

LOW, HIGH = np.array([-1.0, 2.0], np.float32), np.array([1.0, 6.0], np.float32)
RULES = ("mode", "mean", "median")
RNG = np.random.default_rng(0)


def ways(name):
    """The rules of a policy over bins; the units of one that has them; else nothing to choose."""
    if name in ("joint", "spline"):
        return [{"deterministic_action": rule} for rule in RULES[:2]]
    if POLICIES[name].family == "histogram":
        return [{"deterministic_action": rule} for rule in RULES]
    if issubclass(POLICIES[name], GaussianHead):
        more = [{"tanh_mean": True, "state_dependent_std": True}] if name == "gaussian" else []
        return [{"box_units": 0.0}, {"box_units": 1.0}, {"box_units": 1.0, "state_dependent_std": True}, *more]
    return [{}]


@pytest.mark.parametrize("name", POLICIES)
def test_the_action_of_outputs_is_that_of_their_distribution(name):
    for way in ways(name):
        size = {"n_bins": 9} if POLICIES[name].family == "histogram" else {}
        policy = agent({"loss": "gaussian", "policy": name} | size | way, low=LOW, high=HIGH).policy
        _, params = policy.init()
        params |= {name: params[name] + RNG.normal(size=params[name].shape) for name in params if name != "log_std"}
        outputs = 2 * np.asarray(jax.random.normal(jax.random.key(0), (40, policy.n_outputs)))
        graph = Graph(params)
        chosen = ACTIONS[name](graph, OBSERVATION, policy)
        graph.add("Min", graph.add("Max", chosen.action, LOW), HIGH, name=ACTION)
        content = encode(Decision(graph, (policy.n_outputs,), LOW, HIGH, chosen))
        (found,) = onnxruntime.InferenceSession(content).run([ACTION], {OBSERVATION: outputs})
        expected = policy.distribution(outputs, params).deterministic_action()
        np.testing.assert_allclose(found, expected, rtol=1e-5, atol=1e-5)
        assert np.ptp(found, 0).min() > 0.1
