"""`head_rate="per-std"` moves the last layer alone, so far that a softmax's mean keeps pace with a Gaussian's."""

import math

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import galton
from galton.algorithms import actor_critic
from galton.parts import Box
from galton.policies import Histogram

BOX = Box((-1.0, 0.0), (1.0, 3.0))
K = 40


def agent_of(**settings):
    words = {"policy": "histogram", "loss": "hl-one-hot", "n_bins": K, "net_arch": (8,), "head_rate": "per-std"}
    return galton.make_agent(**words | settings).on(BOX)


@pytest.mark.parametrize("log_std", [-1.5, -2.0])
def test_the_rate_is_the_inverse_of_how_much_slower_the_mean_is(log_std):
    """P4: it moves √(2/π) σ as far as a Gaussian's, with σ in half-widths of the box."""
    policy = agent_of(initial_policy="gaussian", log_std_init=log_std, box_units=1.0).policy
    logits = jnp.tile(policy.init()[0], (5, 1))
    rates = policy.head_rates(policy.distribution(logits, {}))
    assert rates.shape == (2 * K,)
    np.testing.assert_allclose(rates * math.sqrt(2 / math.pi) * math.exp(log_std), 1, rtol=0.01)


def test_a_policy_that_is_certain_counts_as_one_bin_wide():
    policy = agent_of().policy
    certain = Histogram(policy.bins, jnp.zeros((3, 2, K)).at[..., 7].set(1e3))
    np.testing.assert_allclose(policy.head_rates(certain), math.sqrt(math.pi / 2) * K / 2, rtol=1e-5)


def test_it_moves_the_last_layer_alone_and_leaves_it_where_a_step_is_left_off():
    faster, plain = agent_of(), agent_of(head_rate="constant")
    learner = actor_critic.init(jax.random.key(0), plain, 3)
    observation = jnp.linspace(-1, 1, 12).reshape(4, 3)

    def objective(params, agent):
        distribution = actor_critic.distribution(agent, params, observation)
        loss = agent.loss(distribution, jnp.zeros((4, 2)) + 0.5)
        parts = actor_critic.objective(agent, learner, distribution, loss, jnp.arange(4.0), jnp.zeros(4))
        return parts.total, parts

    after = {}
    for agent in (faster, plain):
        gradient, parts = jax.grad(objective, has_aux=True)(learner.params, agent)
        after[agent.policy.head_rate] = actor_critic.step(agent, learner, gradient, parts)[0].params
        stays, _ = actor_critic.step(agent, learner, gradient, parts, jnp.array(False))
        jax.tree.map(np.testing.assert_array_equal, stays.params, learner.params)
    rates = faster.policy.head_rates(actor_critic.distribution(plain, learner.params, observation))
    for name, old in learner.params["actor"][-1].items():
        moved, usually = (after[kind]["actor"][-1][name] - old for kind in ("per-std", "constant"))
        assert abs(usually).max() > 0
        np.testing.assert_allclose(moved, rates * usually, rtol=1e-3, atol=1e-9)
    others = [{"hidden": params["actor"][:-1], "critic": params["critic"]} for params in after.values()]
    jax.tree.map(np.testing.assert_array_equal, *others)


def test_a_gradient_that_is_not_finite_moves_nothing_where_the_rate_is_no_number_either():
    agent = agent_of()
    learner = actor_critic.init(jax.random.key(0), agent, 3)
    gradient = jax.tree.map(lambda x: jnp.full_like(x, jnp.nan), learner.params)
    parts = actor_critic.Objective(*jnp.zeros(4), jnp.full(2 * K, jnp.nan))
    after, told = actor_critic.step(agent, learner, gradient, parts)
    assert np.isnan(told["grad_norm"])
    jax.tree.map(np.testing.assert_array_equal, after.params, learner.params)


@pytest.mark.parametrize("policy", ["histogram", "ordinal", "smoothed", "autoregressive"])
def test_heads_beside_a_choice_have_their_rate_and_the_choice_has_one(policy):
    """The numbers' rates are those of the same head without a choice."""
    box = Box.of([-1.0, 0.0, 0.0], [1.0, 3.0, 4.0], [0, 0, 5])
    words = {"policy": policy, "loss": "hl-one-hot", "n_bins": K, "head_rate": "per-std"}
    both, alone = (galton.make_agent(**words).on(each) for each in (box, BOX))
    outputs = jax.random.normal(jax.random.key(0), (6, both.policy.n_outputs))

    def rates(agent, outputs, action):
        params = actor_critic.init(jax.random.key(0), agent, 3).params
        return agent.policy.head_rates(actor_critic.as_update_sees(agent, outputs, params, action))

    action = jnp.array([0.5, 0.5, 3.0])
    expected = rates(alone, outputs[:, : alone.policy.n_outputs], jnp.tile(action[:2], (6, 1)))
    np.testing.assert_allclose(rates(both, outputs, jnp.tile(action, (6, 1))), [*expected, *np.ones(5)], rtol=1e-6)
