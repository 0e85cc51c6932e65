"""A σ that depends on the state: in each state every Gaussian is the one whose own log σ is what the network says."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy import stats

import galton
from galton.algorithms import actor_critic
from galton.policies import POLICIES, GaussianHead

from ..agents import agent

NAMES = [name for name, kind in POLICIES.items() if issubclass(kind, GaussianHead)]
LOW, HIGH = np.array([-1.0, 0.0], np.float32), np.array([1.0, 3.0], np.float32)
RNG = np.random.default_rng(0)
MEAN, LOG_STD = (jnp.asarray(RNG.normal(at, width, (6, 2)), jnp.float32) for at, width in ((0.0, 1.0), (-1.0, 0.7)))
OUTPUTS = jnp.concatenate([MEAN, LOG_STD], -1)


def policy_of(name, **words):
    return agent({"loss": "gaussian", "policy": name, **words}, low=LOW, high=HIGH).policy


def probes(policy, outputs, params, noise, action):
    found = policy.distribution(outputs, params)
    return found.log_prob(action), found.entropy(), found.std(), found.sample(noise), found.deterministic_action()


@pytest.mark.parametrize("name", NAMES)
def test_in_each_state_it_is_the_policy_of_that_sigma_and_so_is_its_gradient(name):
    numbers = {"box_units": 1.0, "log_std_min": -1.5}
    whole, each = policy_of(name, state_dependent_std=True, **numbers), policy_of(name, **numbers)
    noise = each.noise(jax.random.key(0), (6,))
    beside = {name: value + 0.7 for name, value in each.init()[1].items() if name != "log_std"}
    action = each.distribution(MEAN[0], beside | {"log_std": jnp.zeros(2)}).sample(noise)

    def of_one(mean, log_std, noise, action):
        return probes(each, mean, beside | {"log_std": log_std}, noise, action)

    found = jax.jit(lambda *given: probes(whole, given[0], beside, *given[1:]))(OUTPUTS, noise, action)
    for ours, theirs in zip(found, jax.jit(jax.vmap(of_one))(MEAN, LOG_STD, noise, action), strict=True):
        np.testing.assert_allclose(ours, theirs, rtol=1e-5, atol=1e-6)
    ours = jax.jit(jax.grad(lambda outputs: probes(whole, outputs, beside, noise, action)[0].sum()))(OUTPUTS)
    slopes = jax.jit(jax.vmap(jax.grad(lambda *given: of_one(*given)[0], (0, 1))))(MEAN, LOG_STD, noise, action)
    np.testing.assert_allclose(ours, np.concatenate(slopes, -1), rtol=1e-4, atol=1e-5)
    assert (np.asarray(ours)[:, 2:] == 0).any()
    assert (np.asarray(ours)[:, 2:] != 0).any()  # the floor's, and others


def test_the_gaussian_is_scipys():
    found = policy_of("gaussian", state_dependent_std=True).distribution(OUTPUTS, {})
    known, action = stats.norm(MEAN, np.exp(LOG_STD)), jnp.asarray(RNG.normal(size=(6, 2)), jnp.float32)
    np.testing.assert_allclose(found.log_prob(action), known.logpdf(action).sum(-1), rtol=1e-5)
    np.testing.assert_allclose(found.entropy(), known.entropy().sum(-1), rtol=1e-5)


@pytest.mark.parametrize("name", ["gaussian", "squashed-gaussian"])
def test_it_starts_where_log_std_init_says_at_any_scale_of_the_head(name):
    numbers = {"log_std_init": -0.7, "head_scale": 4.0, "net_arch": (8,), "box_units": 1.0}
    made = agent({"loss": "gaussian", "policy": name, "state_dependent_std": True, **numbers}, low=LOW, high=HIGH)
    params = actor_critic.init(jax.random.key(0), made, 3).params
    assert "log_std" not in params
    at_zero = jax.tree.map(jnp.zeros_like, params["actor"][-1]) | {"bias": params["actor"][-1]["bias"]}
    params = params | {"actor": [*params["actor"][:-1], at_zero]}
    found = actor_critic.distribution(made, params, jnp.ones((1, 3)))
    of_own = policy_of(name, box_units=1.0, log_std_init=-0.7)
    first, own = of_own.init()
    np.testing.assert_allclose(found.std()[0], of_own.distribution(first, own).std(), rtol=1e-6)


def test_rpo_moves_means_and_no_sigma():
    rpo = policy_of("rpo", state_dependent_std=True)
    moves = rpo.moved(OUTPUTS, jax.random.key(1)) - OUTPUTS
    assert (np.asarray(moves)[:, :2] != 0).all()
    assert (np.asarray(moves)[:, 2:] == 0).all()


def test_a_model_learns_a_width_for_each_state_and_is_kept(tmp_path):
    model = galton.PPO("lqr", "gaussian", state_dependent_std=True, n_steps=32, batch_size=16, net_arch=(8,))
    model.learn(64, progress_bar=False)
    again = galton.PPO.load(model.save(tmp_path / "model"), "lqr")
    assert again.settings["state_dependent_std"]
    states = RNG.normal(size=(5, *model.observation_space.shape)).astype(np.float32)
    std = actor_critic.distribution(again.agent, again.learner.params, jnp.asarray(states)).std()
    assert (np.ptp(std, 0) > 0).all()
