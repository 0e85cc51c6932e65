"""What PPO's weight makes of each loss: at K = I PPO itself, in the first minibatch A2C. In float64."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from galton import LOSSES, POLICIES, Bins
from galton.algorithms import actor_critic, ppo
from galton.losses import cross_entropy
from galton.networks import mlp
from galton.policies import TruncatedGaussianPolicy
from galton.types import Transition

from .minibatches import HIGH, LOW, SIZE, WIDTH, K, N, T, agent_of, fresh, moved, normal, rollout_of, with_a2c

FITTING = [
    (policy, loss)
    for loss, entry in LOSSES.items()
    for policy, kind in POLICIES.items()
    if entry.family in ("density", kind.family)
]
FIRST = ("gaussian", "histogram")


def marked(pairs):
    """All but those of RPO, which sees other outputs each time; those of later policies are slow."""
    return [
        pytest.param(policy, loss, marks=[] if policy in FIRST else pytest.mark.slow)
        for policy, loss in pairs
        if policy != "rpo"
    ]


LIKELIHOODS = [(policy, loss) for policy, loss in FITTING if loss in ("gaussian", "hl-one-hot")]


@pytest.fixture(autouse=True)
def double():
    with jax.enable_x64(True):
        yield


def fit(agent, learner, rows, orders):
    return jax.jit(lambda learner, rows: ppo.fit(agent, learner, rows, orders))(learner, rows)


def deep(agent):
    """A rollout, who sampled it, and the parameters after three epochs on it, where some ratios are clipped.

    The truncated Gaussian, whose ratios leave 1 more slowly, gets five.
    """
    learner = moved(agent)
    batch = rollout_of(agent, learner)
    n_epochs = 5 if isinstance(agent.policy, TruncatedGaussianPolicy) else 3
    orders = jnp.stack([jax.random.permutation(jax.random.key(i), T * N) for i in range(n_epochs)])
    after, told = fit(agent, learner, ppo.prepare(agent, learner, batch), orders)
    assert 0.1 < told["clip_fraction"] < 0.9
    return batch, learner, after.params


def first_moments(before, after):
    """The gradient of Adam's first step, whose first moment is a tenth of it."""
    assert int(before.optimizer.count) == 0
    assert int(after.optimizer.count) == 1
    return jax.tree.map(lambda moment: moment / 0.1, after.optimizer.mu)


def gradient(agent, params, rows):
    """PPO's at these parameters, on all rows as one minibatch; and what it tells of them."""
    size = len(rows.advantage)
    agent = agent.replace(algorithm=agent.algorithm.replace(batch_size=size))
    learner = fresh(agent, params)
    after, told = fit(agent, learner, rows, jnp.arange(size)[None])
    return first_moments(learner, after), told


def check_equal(ours, theirs, tolerance):
    """Array by array, relative to its largest entry."""
    for a, b in zip(jax.tree.leaves(ours), jax.tree.leaves(theirs), strict=True):
        assert a.dtype == b.dtype == np.float64
        scale = float(jnp.abs(b).max())
        assert scale > 1e-6
        np.testing.assert_allclose(a, b, rtol=0, atol=tolerance * scale)


@pytest.mark.parametrize("eta", [pytest.param(0.05, marks=pytest.mark.slow), 0.1])
@pytest.mark.parametrize("loss", [pytest.param("hl-gauss", marks=pytest.mark.slow), "hl-gauss-centred"])
@pytest.mark.parametrize("policy", ["histogram", pytest.param("ordinal", marks=pytest.mark.slow)])
@pytest.mark.parametrize("ratio", ["smoothed", "true"])
def test_with_narrow_targets_every_histogram_loss_is_ppo_on_hl_one_hot(ratio, policy, loss, eta):
    one_hot = agent_of(policy, "hl-one-hot", normalize_advantage=True, ratio=ratio)
    batch, sampling, params = deep(one_hot)

    def at(agent):
        return gradient(agent, params, ppo.prepare(agent, sampling, batch))

    def of_width(eta):
        return agent_of(policy, loss, eta=eta, normalize_advantage=True, ratio=ratio)

    expected, told = at(one_hot)
    assert 0 < told["clip_fraction"] < 1
    check_equal(at(of_width(eta))[0], expected, 1e-6)
    wide, _ = at(of_width(1.0))
    with pytest.raises(AssertionError):
        check_equal(wide, expected, 1e-2)


@pytest.mark.parametrize("advantage", [-2.0, 0.0, 0.5])
@pytest.mark.parametrize("clip_range", [0.1, 0.3])
def test_the_gate_is_the_slope_of_the_clipped_surrogate_on_each_side_of_its_bounds(clip_range, advantage):
    bounds = jnp.array([1 - clip_range, 1 + clip_range])
    ratio = jnp.concatenate([jnp.array([0.01, 1.0, 5.0]), bounds - 1e-9, bounds + 1e-9])

    def clipped_surrogate(ratio):
        return jnp.minimum(ratio * advantage, jnp.clip(ratio, *bounds) * advantage)

    slope = jax.vmap(jax.grad(clipped_surrogate))(ratio)  # ∇ r is r ∇ log π
    np.testing.assert_array_equal(advantage * ppo.gated(ratio, jnp.full(7, advantage), clip_range), ratio * slope)


@pytest.mark.parametrize("ratio", [pytest.param("smoothed", marks=pytest.mark.slow), "true"])  # the same, for them
@pytest.mark.parametrize(("policy", "loss"), marked(LIKELIHOODS))
def test_the_gated_weights_gradient_is_that_of_ppos_clipped_surrogate(policy, loss, ratio):
    agent = agent_of(policy, loss, ratio=ratio)
    batch, sampling, params = deep(agent)
    rows = ppo.prepare(agent, sampling, batch)

    def clipped_surrogate(params):
        distribution = agent.policy.distribution(mlp(params["actor"], rows.observation), params)
        ratio = jnp.exp(distribution.log_prob(rows.action) - rows.log_prob)
        clipped = jnp.clip(ratio, 1 - agent.algorithm.clip_range, 1 + agent.algorithm.clip_range)
        policy_loss = -jnp.minimum(ratio * rows.advantage, clipped * rows.advantage).mean()
        value_loss = ((mlp(params["critic"], rows.observation)[:, 0] - rows.returns) ** 2).mean()
        return (
            policy_loss
            + agent.algorithm.vf_coef * value_loss
            - agent.algorithm.ent_coef * distribution.entropy().mean()
        )

    check_equal(gradient(agent, params, rows)[0], jax.grad(clipped_surrogate)(params), 1e-9)


@pytest.mark.parametrize("loss", ["hl-gauss", "hl-gauss-centred"])
def test_the_smoothed_ratios_gradient_is_that_of_its_clipped_surrogate(loss):
    agent = agent_of("histogram", loss, ratio="smoothed")
    batch, sampling, params = deep(agent)
    rows = ppo.prepare(agent, sampling, batch)

    def clipped_surrogate(params):
        def measured(params):
            distribution = agent.policy.distribution(mlp(params["actor"], rows.observation), params)
            return cross_entropy(distribution, rows.target), distribution.entropy().mean()

        (ours, entropy), (sampled, _) = measured(params), measured(sampling.params)
        ratio = jnp.exp(sampled - ours)
        clipped = jnp.clip(ratio, 1 - agent.algorithm.clip_range, 1 + agent.algorithm.clip_range)
        policy_loss = -jnp.minimum(ratio * rows.advantage, clipped * rows.advantage).mean()
        value_loss = ((mlp(params["critic"], rows.observation)[:, 0] - rows.returns) ** 2).mean()
        return policy_loss + agent.algorithm.vf_coef * value_loss - agent.algorithm.ent_coef * entropy

    check_equal(gradient(agent, params, rows)[0], jax.grad(clipped_surrogate)(params), 1e-9)


@pytest.mark.parametrize(
    ("ratio", "normalize_advantage"),
    [
        ("smoothed", True),
        ("true", False),
        pytest.param("smoothed", False, marks=pytest.mark.slow),
        pytest.param("true", True, marks=pytest.mark.slow),
    ],
)
@pytest.mark.parametrize(("policy", "loss"), marked(FITTING))
def test_the_first_minibatch_of_the_first_epoch_is_a2cs(policy, loss, ratio, normalize_advantage):
    agent = agent_of(policy, loss, normalize_advantage=normalize_advantage, ratio=ratio)
    learner = moved(agent)
    rows = ppo.prepare(agent, learner, rollout_of(agent, learner))
    some = jax.random.permutation(jax.random.key(5), T * N)[:SIZE]
    after, _ = fit(agent, learner, rows, some[None])

    # As steps that end their episodes with the return for a reward, the same rows have the same advantages in A2C.
    ends = jnp.ones((SIZE, 1), bool)
    column = jax.tree.map(lambda x: x[some][:, None], rows)
    batch = Transition(column.observation, column.action, column.returns, column.observation, ends, ~ends)
    actor_critics = with_a2c(agent)
    update = actor_critics.algorithm.update
    a2cs, _ = jax.jit(lambda learner: update(actor_critics, learner, batch, jax.random.key(0)))(learner)
    check_equal(first_moments(learner, after), first_moments(learner, a2cs), 1e-9)


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
    found, told = gradient(agent, params, rows)
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
