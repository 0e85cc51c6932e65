"""KL divergences: of Gaussians and softmaxes as torch has them in float64, of every policy that has one by sampling."""

import jax
import numpy as np
import pytest
import torch
from gymnasium.spaces import Box, Dict, Discrete
from torch import distributions

from galton import POLICIES, make_agent
from galton.envs.host.actions import Actions
from galton.policies import Sequential

from ..agents import agent

LOW, HIGH = np.array([-1.0, -2.0]), np.array([1.0, 2.0])
WITH_KL = [name for name, kind in POLICIES.items() if kind.has_kl]


def two(policy, outputs=None, **words):
    """Two distributions of a policy, from unlike outputs and unlike parameters beside the network."""
    made = agent({"policy": policy, "loss": "gaussian", "n_bins": 7, "n_steps": 8, **words}, low=LOW, high=HIGH).policy
    first, extra = made.init()
    keys = jax.random.split(jax.random.key(3), 2)
    outputs = [first + 0.4 * jax.random.normal(key, (5, made.n_outputs), float) for key in keys]
    params = [jax.tree.map(lambda x, by=by: x - by, extra) for by in (0.3, 0.6)]
    return made, [made.distribution(*both) for both in zip(outputs, params, strict=True)]


@pytest.mark.parametrize("words", [{}, {"box_units": 1.0}, {"state_dependent_std": True}], ids=str)
def test_gaussians_is_torchs_and_its_parts_move_one_of_mean_and_std(double, words):
    _, (p, q) = two("gaussian", **words)
    tensor = lambda x: torch.tensor(np.broadcast_to(x, (5, 2)).copy())  # noqa: E731

    def kl(mean, std):
        pair = distributions.Normal(tensor(p.mean), tensor(p.sigma)), distributions.Normal(tensor(mean), tensor(std))
        return distributions.kl_divergence(*pair).sum(-1).numpy()

    np.testing.assert_allclose(p.kl(q), kl(q.mean, q.sigma), rtol=1e-12)
    parts = p.kl_parts(q)
    np.testing.assert_allclose(parts["mean"], kl(q.mean, p.sigma), rtol=1e-12)
    np.testing.assert_allclose(parts["std"], kl(p.mean, q.sigma), rtol=1e-12)


def test_a_softmaxs_is_torchs(double):
    _, (p, q) = two("histogram")
    pair = (distributions.Categorical(logits=torch.tensor(np.array(x.logits))) for x in (p, q))
    np.testing.assert_allclose(p.kl(q), distributions.kl_divergence(*pair).sum(-1), rtol=1e-12)
    np.testing.assert_array_equal(p.kl_parts(q)["bins"], p.kl(q))


@pytest.mark.parametrize("policy", WITH_KL)
def test_it_is_the_mean_of_the_difference_of_log_probabilities(policy):
    made, (p, q) = two(policy)
    n = 20_000
    sampled = jax.vmap(lambda noise: p.sample(noise))(made.noise(jax.random.key(0), (n, 5)))
    gaps = np.array(jax.vmap(lambda a: p.log_prob(a) - q.log_prob(a))(sampled))

    def given(action):  # one dimension after the other it is a mean over the policy's own actions
        first, second = (one.given(action) if isinstance(one, Sequential) else one for one in (p, q))
        assert hasattr(first, "kl_parts")
        return first.kl(second), first.kl(first)

    kl, of_itself = (np.array(found).mean(0) for found in jax.vmap(given)(sampled))
    assert (np.abs(gaps.mean(0) - kl) < 5 * gaps.std(0) / np.sqrt(n)).all()
    assert (kl > 0.01).all()
    np.testing.assert_allclose(of_itself, 0.0, atol=1e-6)


def test_of_numbers_and_choices_it_is_the_sum():
    box = Actions("the test", Dict({"n": Discrete(3), "x": Box(-1, 1, (2,))})).box
    policy = make_agent(loss="gaussian").on(box).policy
    _, extra = policy.init()
    outputs = jax.random.normal(jax.random.key(1), (2, 5, policy.n_outputs))
    p, q = (policy.distribution(one, extra) for one in outputs)
    each = [own.kl(other) for (own, _), (other, _) in zip(p.parts, q.parts, strict=True)]
    assert len(each) == 2
    np.testing.assert_allclose(p.kl(q), each[0] + each[1], rtol=1e-6)
    parts = p.kl_parts(q)
    assert {*parts} == {"mean", "std", "bins"}
    np.testing.assert_allclose(sum(parts.values()), p.kl(q), rtol=1e-5)  # σ is the same in both
