"""Policies over numbers and choices, some of them masked: against enumeration of all that they can do."""

import itertools

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.special import log_softmax, softmax

from galton import UsageError, make_agent, targets
from galton.bins import Bins, UnevenBins
from galton.losses import HLGauss, HLGaussCentred
from galton.parts import Box
from galton.policies import HistogramPolicy
from galton.policies.histogram import Choices, Histogram

BOX = Box((-1.0, 0.0, 0.0, 2.0), (1.0, 2.0, 4.0, 5.0), (0, 3, 5, 0))
"""A number, a choice among 3, one among 5, and a number."""
K = 4
SIZES = (K, 3, 5, K)
RNG = np.random.default_rng(0)


def on(box=BOX, **words):
    return make_agent(**{"n_bins": K, "algorithm": "ppo"} | words).on(box)


def outputs_of(agent, n=6):
    return jnp.asarray(RNG.normal(size=(n, agent.policy.n_outputs)), jnp.float32)


def rows_of(outputs):
    return np.split(np.asarray(outputs, float), np.cumsum(SIZES)[:-1], -1)


@pytest.mark.parametrize("loss", ["hl-one-hot", "hl-gauss", "gaussian"])
def test_a_histogram_of_numbers_and_choices_is_the_product_of_softmaxes(loss):
    agent = on(loss=loss, policy="histogram")
    assert type(agent.policy) is HistogramPolicy
    assert agent.policy.n_outputs == sum(SIZES)
    outputs = outputs_of(agent)
    found, rows = agent.policy.distribution(outputs, {}), rows_of(outputs)
    centers = [found.bins.centers[i, :n] for i, n in enumerate(SIZES)]
    np.testing.assert_array_equal(centers[1], [0, 1, 2])
    every = list(itertools.product(*(range(n) for n in SIZES)))
    chances = np.zeros(6)
    for index in every[::17]:
        action = jnp.array([c[i] for c, i in zip(centers, index, strict=True)], jnp.float32)
        expected = sum(log_softmax(row, -1)[:, i] for row, i in zip(rows, index, strict=True))
        np.testing.assert_allclose(found.log_prob(jnp.tile(action, (6, 1))), expected, rtol=1e-5)
    for index in every:
        chances += np.exp(sum(log_softmax(row, -1)[:, i] for row, i in zip(rows, index, strict=True)))
    np.testing.assert_allclose(chances, 1)
    entropy = -sum((softmax(row, -1) * log_softmax(row, -1)).sum(-1) for row in rows)
    np.testing.assert_allclose(found.entropy(), entropy, rtol=1e-5)
    acting = found.deterministic_action()
    np.testing.assert_array_equal(acting[:, 1], rows[1].argmax(-1))
    np.testing.assert_array_equal(agent.acting_by("mean").policy.distribution(outputs, {}).deterministic_action()[:, 2],
                                  rows[2].argmax(-1))  # fmt: skip
    assert agent.policy.uniform_entropy == pytest.approx(np.log(SIZES).mean())


@pytest.mark.parametrize(
    "words",
    [{"loss": "gaussian"}, {"loss": "gaussian", "policy": "beta"}, {"loss": "hl-one-hot", "policy": "anchored"}],
)
def test_a_head_beside_softmaxes_is_the_product_of_both(words):
    agent, alone = on(**words), make_agent(**{"n_bins": K} | words).on(BOX.only(BOX.numbers))
    assert agent.policy.n_outputs == alone.policy.n_outputs + 8
    first, params = agent.policy.init()
    assert params.keys() == alone.policy.init()[1].keys()
    assert first.shape == (agent.policy.n_outputs,)
    outputs = outputs_of(agent)
    own, *logits = np.split(outputs, [alone.policy.n_outputs, alone.policy.n_outputs + 3], -1)
    numbers, found = alone.policy.distribution(jnp.asarray(own), params), agent.policy.distribution(outputs, params)
    action = found.sample(agent.policy.noise(jax.random.key(0), (6,)))
    index = np.asarray(action).astype(int)
    chosen = [log_softmax(logits[i - 1], -1)[np.arange(6), index[:, i]] for i in (1, 2)]
    expected = numbers.log_prob(action[:, jnp.array([0, 3])]) + sum(chosen)
    np.testing.assert_allclose(found.log_prob(action), expected, rtol=1e-4, atol=1e-5)
    entropy = numbers.entropy() - sum((softmax(row, -1) * log_softmax(row, -1)).sum(-1) for row in logits)
    np.testing.assert_allclose(found.entropy(), entropy, rtol=1e-4)
    deterministic = found.deterministic_action()
    np.testing.assert_array_equal(deterministic[:, jnp.array([0, 3])], numbers.deterministic_action())
    np.testing.assert_array_equal(deterministic[:, 2], logits[1].argmax(-1))
    np.testing.assert_allclose(jax.nn.softplus(agent.loss(found, action)), jax.nn.softplus(-found.log_prob(action)))


def test_where_all_dimensions_look_alike_uneven_bins_change_nothing():
    even = Bins([-1.0, -1.0], [1.0, 1.0], 7)
    uneven = UnevenBins([Bins(-1.0, 1.0, 7)] * 2)
    logits = jnp.asarray(RNG.normal(size=(5, 2, 7)), jnp.float32)
    action = jnp.asarray(RNG.uniform(-1.2, 1.2, (5, 2)), jnp.float32)
    loss = HLGaussCentred(eta=0.8)
    for ours, theirs in zip(
        *(
            (bins.encode(action), bins.at_edge(action), found.log_prob(action), loss(found, action), found.std())
            for bins in (uneven, even)
            for found in [Histogram(bins, logits)]
        ),
        strict=True,
    ):
        np.testing.assert_allclose(ours, theirs, rtol=2e-6, atol=1e-6)


@pytest.mark.parametrize("rule", ["fixed", "policy"])
@pytest.mark.parametrize("loss", ["hl-gauss", "hl-gauss-centred"])
def test_a_wide_target_reaches_other_bins_of_a_number_and_no_other_value_of_a_choice(loss, rule):
    agent = on(loss=loss, policy="histogram", eta=1.0, eta_rule=rule)
    found = agent.policy.distribution(outputs_of(agent, 1), {})
    target = HLGauss.target(agent.loss, found, found.bins.decode(jnp.array([[1, 2, 4, 0]])))[0]
    np.testing.assert_allclose(target.sum(-1), 1, rtol=1e-6)
    np.testing.assert_array_equal(target[1], [0, 0, 1, 0, 0])
    np.testing.assert_array_equal(target[2], [0, 0, 0, 0, 1])
    assert (target[0, :4] > 0.05).all()
    assert target[0, 4] == 0
    expected = agent.loss.expected_target(found)[0]
    np.testing.assert_allclose(expected[1], found.probs[0, 1], rtol=1e-6)
    eta = agent.loss.width(found) if rule == "fixed" else agent.loss.width(found)[0, 0]
    kernel = np.asarray(targets.hl_gauss_of_center(K, jnp.arange(K), float(eta)))
    np.testing.assert_allclose(target[0, :4], kernel[1], rtol=1e-5)
    np.testing.assert_allclose(expected[0, :4], np.asarray(found.probs[0, 0, :4]) @ kernel, rtol=1e-5)


MASK = np.array([1, 0, 1, 0, 0, 1, 1, 0], np.float32)
MASKED = BOX._replace(n_mask=8)


@pytest.mark.parametrize("words", [{"loss": "hl-one-hot"}, {"loss": "gaussian"}])
def test_what_is_masked_has_no_probability_no_gradient_and_is_never_drawn(words):
    agent, n = on(MASKED, **words), 200_000
    outputs, params = outputs_of(agent, 1), agent.policy.init()[1]

    def probe(outputs, action):
        found = agent.policy.distribution(agent.policy.masked(outputs, jnp.asarray(MASK)[None]), params)
        return agent.loss(found, action).sum() + found.entropy().sum()

    found = agent.policy.distribution(agent.policy.masked(outputs, jnp.asarray(MASK)[None]), params)
    drawn = jax.vmap(lambda key: found.sample(agent.policy.noise(key, (1,)))[0])(jax.random.split(jax.random.key(0), n))
    for place, allowed in ((1, MASK[:3]), (2, MASK[3:])):
        counts = np.bincount(np.asarray(drawn)[:, place].astype(int), minlength=len(allowed))
        assert (counts[allowed == 0] == 0).all()
        assert (counts[allowed == 1] > 0).all()
    slope = np.asarray(jax.grad(probe)(outputs, drawn[:1]))[0]
    start = K if words["loss"] == "hl-one-hot" else 2
    of_choices = slope[start : start + 8]
    assert (of_choices[MASK == 0] == 0).all()
    assert np.isfinite(slope).all()
    action = drawn[:1]
    rows = np.split(np.asarray(outputs)[0, start : start + 8], [3])
    logs = [log_softmax(np.where(m, row, -np.inf)) for row, m in zip(rows, np.split(MASK > 0, [3]), strict=True)]
    whole = [int(action[0, i]) for i in (1, 2)]
    unmasked = on(BOX, **words).policy.distribution(outputs, params)
    free = [log_softmax(row)[i] for row, i in zip(rows, whole, strict=True)]
    expected = unmasked.log_prob(action) - sum(free) + sum(log[i] for log, i in zip(logs, whole, strict=True))
    np.testing.assert_allclose(found.log_prob(action), expected, rtol=1e-4)


@pytest.mark.parametrize("rule", ["fixed", "policy"])
def test_targets_are_renormalised_to_what_a_mask_of_bins_allows(rule):
    words = {"loss": "hl-gauss-centred", "policy": "histogram", "n_bins": 6, "eta": 1.5, "eta_rule": rule}
    agent = on(Box((-1.0,), (1.0,), (), 6), **words)
    mask = np.array([0, 1, 1, 0, 1, 1], float)
    outputs = outputs_of(agent, 1)
    found = agent.policy.distribution(agent.policy.masked(outputs, jnp.asarray(mask, jnp.float32)[None]), {})
    eta = 1.5 if rule == "fixed" else float(agent.loss.width(found)[0, 0])
    kernel = np.asarray(targets.hl_gauss_of_center(6, jnp.arange(6), eta)) * mask
    kernel /= kernel.sum(-1, keepdims=True)
    probs = softmax(np.where(mask > 0, np.asarray(outputs, float)[0], -np.inf))
    target = HLGauss.target(agent.loss, found, found.bins.decode(jnp.array([[2]])))
    np.testing.assert_allclose(target[0, 0], kernel[2], rtol=1e-5, atol=1e-7)
    np.testing.assert_allclose(agent.loss.expected_target(found)[0, 0], probs @ kernel, rtol=1e-5, atol=1e-7)


def test_no_rounding_draws_a_bin_without_probability():
    rng, n = np.random.default_rng(5), 2_000
    logits = rng.normal(size=(n, 1, 40)).astype(np.float32) * 3
    allowed = rng.random((n, 1, 40)) < 0.3
    allowed[..., rng.integers(40)] = True
    bins = Bins(0.0, 1.0, 40)
    found = Histogram(bins, jnp.where(allowed, logits, -1e9), Choices(is_masked=True))
    for u in (0.0, 0.5, 1 - 2**-24, *rng.random(50)):
        index = np.asarray(bins.encode(found.sample(jnp.full((n, 1), u, jnp.float32))))
        assert np.take_along_axis(allowed[:, 0], index, 1).all()


@pytest.mark.slow
def test_no_masked_value_is_drawn_in_ten_million_draws():
    rng = np.random.default_rng(1)
    allowed = rng.random((1000, 1, 40)) < rng.uniform(0.03, 0.97, (1000, 1, 1))
    allowed[np.arange(1000), 0, rng.integers(40, size=1000)] = True
    logits = jnp.where(allowed, rng.normal(size=(1000, 1, 40)) * rng.choice([0.1, 3, 50], (1000, 1, 1)), -1e9)
    policy = Histogram(Bins(0.0, 1.0, 40), logits, Choices(is_masked=True))

    def forbidden(u):
        index = policy.bins.encode(policy.sample(u))
        return (~jnp.take_along_axis(jnp.asarray(allowed), index[..., None], -1)).sum()

    u = rng.random((10_000, 1000, 1), np.float32)
    assert not jax.jit(lambda u: jax.lax.map(forbidden, u))(u).sum()


@pytest.mark.parametrize(
    ("words", "message"),
    [
        ({"loss": "hl-gauss", "policy": "anchored"}, "policy is 'anchored' and loss 'hl-gauss', and some actions are"),
        ({"loss": "hl-one-hot", "exploration": "gaussian"}, "exploration is 'gaussian'; where actions are choices"),
        ({"loss": "hl-one-hot", "bin_sample": "uniform"}, "bin_sample is 'uniform'; where actions are choices"),
    ],
)
def test_settings_that_choices_have_no_meaning_for_are_refused(words, message):
    with pytest.raises(UsageError, match=message):
        on(**words)


def test_a_choice_that_is_ordered_has_a_wide_target():
    box = BOX._replace(names=("gas.0", "gear", "mode", "turn.0"))
    agent = make_agent(loss="hl-gauss", n_bins=K, eta=1.0, ordered=("mode",)).on(box)
    found = agent.policy.distribution(outputs_of(agent, 1), {})
    target = HLGauss.target(agent.loss, found, found.bins.decode(jnp.array([[0, 1, 2, 0]])))[0]
    np.testing.assert_array_equal(target[1], [0, 1, 0, 0, 0])
    np.testing.assert_allclose(target[2], targets.hl_gauss_of_center(5, jnp.array(2), 1.0, centers="bounds"), rtol=1e-5)
    assert not np.asarray(agent.policy.init()[0])[K + 3 : K + 8].any(), "it starts uniform"
    assert agent.acting_by("mean").policy.distribution(outputs_of(agent, 1), {}).deterministic_action()[0, 2] % 1 == 0
    by_place = make_agent(loss="hl-gauss", n_bins=K, ordered=[2]).on(BOX)
    np.testing.assert_array_equal(by_place.policy.bins.is_choice, [False, True, True, False])
    for name in ("gas", "gears"):
        with pytest.raises(UsageError, match=f"ordered names '{name}', which is no choice .* are gas.0, gear, mode"):
            make_agent(loss="hl-gauss", ordered=(name,)).on(box)
