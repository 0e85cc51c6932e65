"""`head_scale` is a learning rate of the head's own, and at 1 it is not there."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import galton
from galton.algorithms import actor_critic
from galton.parts import Box
from galton.policies import POLICIES

BOX = Box((-1.0, 0.0), (1.0, 3.0))
OBSERVATION = jnp.linspace(-1, 1, 12).reshape(4, 3)


def learner(policy, **settings):
    agent = galton.make_agent(policy=policy, loss="gaussian", net_arch=(8,), **settings).on(BOX)
    return agent, actor_critic.init(jax.random.key(0), agent, 3)


def probes(agent, params):
    """What a policy does in a few states, whatever its form."""
    distribution = actor_critic.distribution(agent, params, OBSERVATION)
    return distribution.deterministic_action(), distribution.std(), distribution.entropy()


@pytest.mark.few
@pytest.mark.parametrize("policy", POLICIES)
def test_it_is_the_last_layer_times_the_scale_and_leaves_the_first_policy(policy):
    """With a last layer 4 times as large a policy of scale 1 is what one of scale 4 is."""
    plain, of_plain = learner(policy)
    scaled, of_scaled = learner(policy, head_scale=4.0)
    last = jax.tree.map(lambda part: 4 * part, of_scaled.params["actor"][-1])
    np.testing.assert_allclose(last["bias"], of_plain.params["actor"][-1]["bias"], rtol=1e-6)
    params = of_scaled.params | {"actor": [*of_scaled.params["actor"][:-1], last]}
    for found, expected in zip(probes(scaled, of_scaled.params), probes(plain, params), strict=True):
        np.testing.assert_allclose(found, expected, rtol=2e-5, atol=1e-6)


def test_at_one_no_program_has_a_trace_of_it():
    told = []
    for settings in ({}, {"head_scale": 1.0}):
        agent, of = learner("histogram", **settings)
        told.append(str(jax.make_jaxpr(lambda params, agent=agent: probes(agent, params))(of.params)))
    assert told[0] == told[1]
    assert agent.policy.head_scale is None


def test_each_run_may_have_its_own():
    scales = np.array([1.0, 4.0], np.float32)
    many = galton.train("bandit", galton.make_agent(net_arch=(8,), n_bins=10, head_scale=scales), [0, 0], 64)
    for run, scale in enumerate(scales):
        agent = galton.make_agent(net_arch=(8,), n_bins=10, head_scale=float(scale))
        one = galton.train("bandit", agent, [0], 64)
        found, expected = (of.learner.params["actor"][-1]["kernel"] for of in (many, one))
        np.testing.assert_allclose(found[run], expected[0], rtol=1e-4, atol=1e-6)


@pytest.mark.parametrize("scale", [0.0, -1.0, np.inf, np.nan])
def test_it_is_greater_than_zero(scale):
    with pytest.raises(galton.UsageError, match=r"head_scale is .*; it must be finite, and greater than 0"):
        galton.make_agent(head_scale=scale)
