"""What weighs a loss, how wide its target is and what negative weights aim at: against dense formulas in float64."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.stats import norm

from galton import A2C, PPO, Bins, UsageError, make_agent, train
from galton.algorithms import ALGORITHMS, a2c, actor_critic
from galton.losses import surrogate
from galton.policies import Histogram

from ..agents import agent as agent_on

LOW, HIGH, K = np.array([-1.0, 0.0]), np.array([1.0, 5.0]), 12
WIDE = {"eta_rule": "policy"}
SPLIT = {"negative_target": "one-hot"}


def agent_of(loss, **words):
    return agent_on({"loss": loss, "n_bins": K, "n_steps": 8, **words}, low=LOW, high=HIGH)


def batch(n=40, sharp=12.0):
    """Logits of policies from wide to narrow, an action of each bin in turn, and advantages of both signs."""
    keys = jax.random.split(jax.random.key(0), 3)
    spread = jnp.linspace(0.2, sharp, n)[:, None, None]
    index = jax.random.randint(keys[1], (n, 2), 0, K)
    return spread * jax.random.normal(keys[0], (n, 2, K), float), index, jax.random.normal(keys[2], (n,), float)


def kernel(eta):
    """K of one width: row j is the Gaussian histogram around bin j's center, in bin widths."""
    distance = (np.arange(K + 1) - (np.arange(K) + 0.5)[:, None]) / eta
    q = np.diff(norm.cdf(distance))
    return q / q.sum(1, keepdims=True)


def widths(pi, factor, least, most):
    """η of each policy and dimension, from the variance of its bins' numbers."""
    number = np.arange(K)
    mean = (pi * number).sum(-1, keepdims=True)
    return np.clip(factor * np.sqrt((pi * (number - mean) ** 2).sum(-1)), least, most)


@jax.jit
def gradient(loss, logits, index, weight):
    """Of Σ_j w_j loss_j in the logits, uphill."""
    bins = Bins(LOW, HIGH, K)
    action = bins.decode(index)

    def total(logits):
        distribution = Histogram(bins, logits)
        of_negatives = loss.of_negatives(distribution, action)
        losses = actor_critic.by_sign(weight, loss(distribution, action), of_negatives)
        return -surrogate(weight, losses) * len(weight)

    return jax.grad(total)(logits)


@pytest.mark.parametrize("loss", ["hl-gauss", "hl-gauss-centred"])
@pytest.mark.parametrize("fields", [WIDE, SPLIT, WIDE | SPLIT], ids=lambda fields: "+".join(fields))
def test_the_gradient_in_the_logits_is_the_dense_formulas(loss, fields):
    with jax.enable_x64(True):
        logits, index, weight = batch()
        bounds = {"eta_min": 0.7, "eta_max": 2.0} if "eta_rule" in fields else {}
        found = gradient(agent_of(loss, eta=0.8, **bounds, **fields).loss, logits, index, weight)
        pi = np.asarray(jax.nn.softmax(logits))
        eta = widths(pi, 0.8, 0.7, 2.0) if "eta_rule" in fields else np.full(pi.shape[:2], 0.8)
        assert "eta_rule" not in fields or ({0.7, 2.0} < set(eta.ravel().tolist()))
        expected = np.zeros_like(pi)
        for row, dim in np.ndindex(pi.shape[:2]):
            matrix, j, p = kernel(eta[row, dim]), int(index[row, dim]), pi[row, dim]
            away = matrix[j] - (matrix.T @ p if loss == "hl-gauss-centred" else p)
            if "negative_target" in fields and weight[row] < 0:
                away = np.eye(K)[j] - p
            expected[row, dim] = float(weight[row]) * away
        np.testing.assert_allclose(found, expected, atol=1e-12)


def test_off_center_actions_have_the_width_too():
    with jax.enable_x64(True):
        agent, (logits, index, weight) = agent_of("hl-gauss", eta=0.8, **WIDE, bin_sample="uniform"), batch()
        distribution = agent.policy.distribution(logits.reshape(40, -1), {})
        action = distribution.bins.decode(index) + 0.3 * distribution.bins.width
        eta = widths(np.asarray(distribution.probs), 0.8, 0.5, 16.0)
        q = np.diff(norm.cdf((np.arange(K + 1) - (np.asarray(index) + 0.8)[..., None]) / eta[..., None]))
        expected = -((q / q.sum(-1, keepdims=True)) * jax.nn.log_softmax(logits)).sum((-1, -2))
        np.testing.assert_allclose(agent.loss(distribution, action), expected, rtol=1e-6)
        assert len(weight) == 40


def weights(advantage, temperature=1.0, **words):
    with jax.enable_x64(True):
        credit = agent_on({"n_steps": 8, "temperature": temperature, **words}).credit
        return np.asarray(jax.jit(lambda credit, given: credit.weights(given))(credit, np.asarray(advantage, float)))


def test_weights_are_the_advantages_or_the_standardised_ones():
    advantage = np.array([1.0, -2.0, 4.0, 0.5])
    np.testing.assert_array_equal(weights(advantage), advantage)
    expected = (advantage - advantage.mean()) / (advantage.std(ddof=1) + 1e-8)
    np.testing.assert_allclose(weights(advantage, normalize_advantage=True), expected, rtol=1e-12)


def test_awrs_weights_are_exponentials_up_to_20():
    advantage = np.array([-900.0, -1.0, 0.0, 2.0, 5.9, 6.1, 1e6])
    expected = [0.0, np.exp(-0.5), 1.0, np.e, np.exp(2.95), 20.0, 20.0]
    np.testing.assert_allclose(weights(advantage, 2.0, weighting="awr"), expected, rtol=1e-12, atol=1e-100)
    standard = (advantage - advantage.mean()) / (advantage.std(ddof=1) + 1e-8)
    both = weights(advantage, 0.5, weighting="awr", normalize_advantage=True)
    np.testing.assert_allclose(both, np.minimum(np.exp(standard / 0.5), 20), rtol=1e-12)


@pytest.mark.parametrize(
    ("advantage", "better"),
    [
        ([3.0, -1.0, 2.0, 0.0], [True, False, True, False]),
        ([3.0, -1.0, 2.0, 0.0, 1.0], [True, False, True, False, True]),
        ([1.0, 1.0, 1.0, 1.0], [True] * 4),
        ([-1e6, 5e5], [False, True]),
        ([4.0], [True]),
    ],
)
def test_v_mpos_weights_are_a_softmax_over_the_better_half(advantage, better):
    advantage, better = np.array(advantage), np.array(better)
    raised = np.where(better, np.exp((advantage - advantage.max()) / 3.0), 0.0)
    found = weights(advantage, 3.0, weighting="v-mpo")
    np.testing.assert_allclose(found, len(advantage) * raised / raised.sum(), rtol=1e-12)
    assert found.mean() == pytest.approx(1)


REFUSED = [
    (
        {"loss": "gaussian", "negative_target": "one-hot"},
        "negative_target is 'one-hot'; it goes with loss 'hl-gauss'.*",
    ),
    (
        {"loss": "hl-gauss", "negative_target": "one-hot", "weighting": "awr"},
        "negative_target is 'one-hot', but with weighting 'awr' no weight is negative",
    ),
    ({"loss": "hl-gauss", "entropy_target": True, "n_steps": 1}, "entropy_target needs more than one step"),
    ({"entropy_end": 0.1}, "entropy_end is 0.1.*; it goes with entropy_target True, not False"),
    ({"loss": "hl-gauss", "eta_rule": "policy", "eta_min": 3.0, "eta_max": 2.0}, "eta_min is .*3.* and eta_max .*2"),
    ({"weighting": "awr", "temperature": 0.0}, "temperature is 0.0; it must be finite, and greater than 0"),
]


@pytest.mark.parametrize(("settings", "message"), REFUSED)
def test_what_has_no_use_is_refused_by_name(settings, message):
    with pytest.raises(UsageError, match=message):
        A2C("bandit", **{"preset": "paper"} | settings)


def test_ppo_needs_more_than_one_row_in_a_minibatch_to_hold_an_entropy():
    with pytest.raises(UsageError, match="each gradient step: raise batch_size"):
        PPO("bandit", n_steps=4, batch_size=1, normalize_advantage=False, entropy_target=True)


@pytest.mark.parametrize("choice", [SPLIT, {"weighting": "awr"}, {"entropy_target": True}], ids=list)
def test_an_algorithm_that_does_not_carry_out_a_choice_refuses_it(choice, monkeypatch):
    ((name, value),) = choice.items()

    class Plain(a2c.A2C):
        name = "plain"
        choices = ()

    monkeypatch.setitem(ALGORITHMS, "plain", Plain)
    with pytest.raises(UsageError, match=f"{name} is {value!r}, which algorithm 'plain' does not carry out"):
        train("bandit", make_agent(loss="hl-gauss", algorithm="plain", n_steps=8, **choice), [0], 8)
