"""What PPO's weight makes of each loss: at K = I PPO itself, in the first minibatch A2C. In float64."""

import functools

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from galton import LOSSES, POLICIES, Bins
from galton.algorithms import actor_critic, ppo
from galton.losses import HLGauss, cross_entropy
from galton.networks import mlp
from galton.policies import DiscretisedGaussianPolicy, Sequential, TruncatedGaussianPolicy

from .minibatches import (
    HIGH,
    LOW,
    WIDTH,
    K,
    agent_of,
    check_equal,
    check_the_first_minibatch_is_a2cs,
    first_moments,
    fit,
    moved,
    normal,
    orders_of,
    prepare,
    rollout_of,
)

pytestmark = pytest.mark.usefixtures("double")

FITTING = [
    (policy, loss)
    for loss, entry in LOSSES.items()
    for policy, kind in POLICIES.items()
    if entry.family in ("density", kind.family)
]


def cases(pairs, quick, ratios=("smoothed", "true")):
    """The pairs with each ratio, but for RPO, which sees other outputs each time; all but the quick ones are slow."""
    every = [(*pair, ratio) for pair in pairs for ratio in ratios if pair[0] != "rpo"]
    return [pytest.param(*one, marks=[] if one in quick else pytest.mark.slow) for one in every]


LIKELIHOODS = [(policy, loss) for policy, loss in FITTING if loss in ("gaussian", "hl-one-hot")]


@functools.cache
def deep(policy, loss, **words):
    """An agent, who sampled a rollout, the parameters after three epochs, where some ratios are clipped, and rows.

    The truncated and the discretised Gaussian, whose ratios leave 1 more slowly, get five.
    """
    agent = agent_of(policy, loss, **words)
    learner = moved(agent)
    rows = prepare(agent, learner, rollout_of(agent, learner))
    is_slow = isinstance(agent.policy, TruncatedGaussianPolicy) or type(agent.policy) is DiscretisedGaussianPolicy
    n_epochs = 5 if is_slow else 3
    after, told = fit(agent, learner, rows, orders_of(n_epochs))
    assert 0.1 < told["clip_fraction"] < 0.9
    return agent, learner, after.params, rows


def gradient(agent, sampling, params, rows):
    """PPO's at these parameters, on all rows as one minibatch; and what it tells of them."""
    size = len(rows.advantage)
    whole = agent.replace(algorithm=agent.algorithm.replace(batch_size=size))
    learner = sampling._replace(params=params)
    after, told = fit(whole, learner, rows, jnp.arange(size)[None])
    return first_moments(learner, after), told


@pytest.mark.parametrize("eta", [pytest.param(0.05, marks=pytest.mark.slow), 0.1])
@pytest.mark.parametrize("loss", [pytest.param("hl-gauss", marks=pytest.mark.slow), "hl-gauss-centred"])
@pytest.mark.parametrize("policy", ["histogram", pytest.param("ordinal", marks=pytest.mark.slow)])
@pytest.mark.parametrize("ratio", ["smoothed", "true"])
def test_with_narrow_targets_every_histogram_loss_is_ppo_on_hl_one_hot(ratio, policy, loss, eta):
    words = {"normalize_advantage": True, "ratio": ratio}
    one_hot, sampling, params, rows = deep(policy, "hl-one-hot", **words)
    batch = rollout_of(one_hot, sampling)

    def at(eta):
        agent = agent_of(policy, loss, eta=eta, **words)
        return gradient(agent, sampling, params, prepare(agent, sampling, batch))[0]

    expected, told = gradient(one_hot, sampling, params, rows)
    assert 0 < told["clip_fraction"] < 1
    check_equal(at(eta), expected, 1e-6)
    with pytest.raises(AssertionError):
        check_equal(at(1.0), expected, 1e-2)


@pytest.mark.parametrize("advantage", [-2.0, 0.0, 0.5])
def test_the_gate_is_the_slope_of_the_clipped_surrogate_on_each_side_of_its_bounds(advantage):
    @jax.jit
    def both(clip_range):
        bounds = jnp.stack([1 - clip_range, 1 + clip_range])
        ratio = jnp.concatenate([jnp.array([0.01, 1.0, 5.0]), bounds - 1e-9, bounds + 1e-9])

        def clipped_surrogate(ratio):
            return jnp.minimum(ratio * advantage, jnp.clip(ratio, *bounds) * advantage)

        slope = jax.vmap(jax.grad(clipped_surrogate))(ratio)  # ∇ r is r ∇ log π
        return advantage * ppo.gated(ratio, jnp.full(7, advantage), clip_range), ratio * slope

    for clip_range in (0.1, 0.3):
        np.testing.assert_array_equal(*both(clip_range))


QUICK = [
    ("gaussian", "gaussian", "true"),
    ("histogram", "hl-one-hot", "true"),
    ("histogram", "hl-gauss-centred", "smoothed"),  # whose targets move with the policy
]
CLIPPED = cases(LIKELIHOODS, QUICK)  # their losses are −log π, and both ratios the same
CLIPPED += cases([("histogram", loss) for loss in ("hl-gauss", "hl-gauss-centred")], QUICK)


def clipped_surrogates_gradient(agent, sampling, params, rows):
    """By its definition: of min(r w, clip(r) w) where the loss moves the ratio r, else of w r times the loss."""
    weight, own, pair = agent.credit.weights(rows.advantage), agent.algorithm, agent.loss

    def policy_of(params):
        return agent.policy.distribution(mlp(params["actor"], rows.observation), params)

    def measured(params):
        distribution = policy_of(params)
        loss = log_loss = -distribution.log_prob(rows.action)
        if isinstance(pair, HLGauss):
            aims = policy_of(sampling.params) if own.ratio == "smoothed" else distribution
            target = pair.target(aims, rows.action)
            loss = cross_entropy(distribution, jax.lax.stop_gradient(target))
            loss = jnp.where(weight < 0, log_loss, loss) if pair.negative_target == "one-hot" else loss
        known = distribution.given(rows.action) if isinstance(distribution, Sequential) else distribution
        return loss, log_loss, known.entropy().mean()

    def surrogate(params):
        (ours, log_loss, entropy), (sampled, sampled_log_loss, _) = measured(params), measured(sampling.params)
        value = jnp.exp(sampled_log_loss - log_loss if own.ratio == "true" else sampled - ours)
        clipped = jnp.clip(value, 1 - own.clip_range, 1 + own.clip_range)
        policy_loss = -jnp.minimum(value * weight, clipped * weight).mean()
        if own.ratio == "true" and isinstance(pair, HLGauss):  # what is clipped is one thing, what is moved another
            is_open = jnp.where(weight > 0, value <= 1 + own.clip_range, value >= 1 - own.clip_range)
            policy_loss = (jax.lax.stop_gradient(weight * value * is_open) * ours).mean()
        value_loss = ((mlp(params["critic"], rows.observation)[:, 0] - rows.returns) ** 2).mean()
        return policy_loss + own.vf_coef * value_loss - own.ent_coef * entropy

    return jax.jit(jax.grad(surrogate))(params)


@pytest.mark.parametrize(("policy", "loss", "ratio"), CLIPPED)
def test_the_gradient_is_that_of_ppos_clipped_surrogate_with_the_true_or_the_smoothed_ratio(policy, loss, ratio):
    given = deep(policy, loss, ratio=ratio)
    check_equal(gradient(*given)[0], clipped_surrogates_gradient(*given), 1e-9)


FAST = [
    ("gaussian", "gaussian", "true"),
    ("histogram", "hl-gauss", "true"),
    ("histogram", "hl-gauss-centred", "smoothed"),
]
"""With the smoothed ratio the centred loss has a target of its own."""


@pytest.mark.parametrize(("policy", "loss", "ratio"), cases(FITTING, FAST))
def test_the_first_minibatch_of_the_first_epoch_is_a2cs(policy, loss, ratio):
    check_the_first_minibatch_is_a2cs(agent_of(policy, loss, normalize_advantage=False, ratio=ratio))


@pytest.mark.slow
@pytest.mark.parametrize(("policy", "loss", "ratio"), FAST)
def test_so_it_is_with_normalised_advantages(policy, loss, ratio):
    check_the_first_minibatch_is_a2cs(agent_of(policy, loss, normalize_advantage=True, ratio=ratio))


def expected_gradient(policy, loss, shift):
    """The actor's mean gradient over the actions of the policy that samples, at other parameters than its own.

    There is a row for each bin in each of three states. The mean over rows is the expectation since each advantage
    holds the action's probability, which changes no sign.
    """
    one_minibatch = {"n_steps": 3 * K, "n_envs": 1, "batch_size": 3 * K}
    agent = agent_of(policy, loss, d=1, eta=1.0, ent_coef=0.0, ratio="true", **one_minibatch)
    learner = moved(agent)
    observation = jnp.repeat(normal(7, 3, WIDTH), K, 0)
    action = jnp.tile(jnp.asarray(Bins(LOW[:1], HIGH[:1], K).centers[0]), 3)[:, None]
    log_prob = actor_critic.distribution(agent, learner.params, observation).log_prob(action)
    np.testing.assert_allclose(jnp.exp(log_prob).sum(), 3)
    advantage = K * jnp.exp(log_prob) * (normal(8, 3 * K) + shift)
    rows = ppo.Rows(observation, action, advantage, jnp.zeros(3 * K), log_prob, jnp.zeros(3 * K), None)
    params = jax.tree.map(lambda x: x + 0.01 * normal(9, *x.shape), learner.params)
    found, told = gradient(agent, learner, params, rows)
    assert told["clip_fraction"] == 0
    assert told["approx_kl"] > 1e-6
    return found["actor"]


@pytest.mark.slow
@pytest.mark.parametrize(
    ("loss", "indifferent"), [("hl-one-hot", True), ("hl-gauss-centred", True), ("hl-gauss", False)]
)
@pytest.mark.parametrize("policy", ["histogram", pytest.param("ordinal", marks=pytest.mark.slow)])
def test_a_shift_of_the_advantages_moves_no_mean_gradient_but_plain_hl_gausss(policy, loss, indifferent):
    plain, shifted = (expected_gradient(policy, loss, shift) for shift in (0.0, 7.0))
    if indifferent:
        check_equal(shifted, plain, 1e-11)
    else:
        with pytest.raises(AssertionError):
            check_equal(shifted, plain, 1e-1)
