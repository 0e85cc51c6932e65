"""One dimension after the other, beside an enumeration of all actions with the formula written out in numpy."""

import itertools

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy import stats

import galton
from galton.algorithms import actor_critic
from galton.losses import HLGaussCentred, HLOneHot, as_log_prob
from galton.parts import Box
from galton.policies import AutoregressivePolicy, HistogramPolicy, Sequential
from galton.policies.autoregressive import PREFIXES, stratified
from galton.policies.mixed import Mixed

D, K, M = 3, 4, 5
LOW, HIGH = np.array([-1.0, 0.0, -2.0]), np.array([1.0, 3.0, 1.0])
BOX = Box.of(LOW, HIGH)
RNG = np.random.default_rng(0)
CELLS = np.array(list(itertools.product(range(K), repeat=D)))
CENTERS = LOW + (HIGH - LOW) * (CELLS + 0.5) / K


def policy_of(**words):
    return AutoregressivePolicy(**{"n_bins": K, "prefix_width": M} | words).on(BOX)


def params_of():
    return {
        "embedding": jnp.asarray(RNG.normal(size=(D - 1, K, M))),
        "readout": jnp.asarray(RNG.normal(size=(D - 1, M, K))),
    }


def logits_of(outputs, params, cell):
    """The logits of each dimension after the bins of this action before it, `[D, K]`."""
    z, f = outputs[: D * K].reshape(D, K), outputs[D * K :]
    embedding, readout = np.asarray(params["embedding"]), np.asarray(params["readout"])
    rows = [z[0]]
    for i in range(1, D):
        seen = f + sum(embedding[j, cell[j]] for j in range(i))
        rows.append(z[i] + np.tanh(seen) @ readout[i - 1])
    return np.array(rows)


def log_softmax(x):
    return x - np.log(np.exp(x).sum(-1, keepdims=True))


def enumerated(outputs, params):
    """The log-probability of each action."""
    rows = np.array([log_softmax(logits_of(outputs, params, cell)) for cell in CELLS])
    return np.take_along_axis(rows, CELLS[..., None], -1)[..., 0].sum(-1)


OUTPUTS = RNG.normal(size=D * K + M)


@pytest.mark.usefixtures("double")
def test_probabilities_are_the_formulas_and_sum_to_one():
    policy, params = policy_of(), params_of()
    outputs = jnp.broadcast_to(OUTPUTS, (len(CELLS), len(OUTPUTS)))
    found = policy.distribution(outputs, params)
    expected = enumerated(OUTPUTS, params)
    np.testing.assert_allclose(found.log_prob(jnp.asarray(CENTERS)), expected, rtol=1e-10)
    assert np.exp(expected).sum() == pytest.approx(1, rel=1e-12)
    assert isinstance(found, Sequential)
    seen = found.given(jnp.asarray(CENTERS))
    np.testing.assert_allclose(seen.logits, [logits_of(OUTPUTS, params, cell) for cell in CELLS], rtol=1e-10)


@pytest.mark.usefixtures("double")
def test_entropies_given_actions_are_unbiased_and_estimates_near():
    """Σ_a π(a) Σ_l H(· | a_<l) is the joint entropy exactly; 32 actions come within a few hundredths."""
    policy, params = policy_of(), params_of()
    log_probs = enumerated(OUTPUTS, params)
    probs, outputs = np.exp(log_probs), jnp.broadcast_to(OUTPUTS, (len(CELLS), len(OUTPUTS)))
    found = policy.distribution(outputs, params)
    entropy = -(probs * log_probs).sum()
    assert probs @ np.asarray(found.given(jnp.asarray(CENTERS)).entropy()) == pytest.approx(entropy, rel=1e-10)
    assert float(found.entropy()[0]) == pytest.approx(entropy, abs=0.05)
    std = np.sqrt(probs @ CENTERS**2 - (probs @ CENTERS) ** 2)
    np.testing.assert_allclose(found.std()[0], std, rtol=0.05)


def test_prefixes_are_stratified():
    np.testing.assert_allclose(np.sort(stratified(3), 0), np.tile((np.arange(PREFIXES)[:, None] + 0.5) / PREFIXES, 3))
    assert abs(np.corrcoef(stratified(3).T) - np.eye(3)).max() < 0.5


@pytest.mark.parametrize("bin_sample", ["center", "uniform"])
def test_actions_are_drawn_as_often_as_they_are_likely(bin_sample):
    policy, params, n = policy_of(bin_sample=bin_sample), params_of(), 50_000
    found = policy.distribution(jnp.broadcast_to(OUTPUTS, (n, len(OUTPUTS))), params)
    action = np.asarray(found.sample(policy.noise(jax.random.key(3), (n,))))
    index = np.floor((action - LOW) / (HIGH - LOW) * K).astype(int).clip(0, K - 1) @ [K * K, K, 1]
    probs = np.exp(enumerated(OUTPUTS, params))
    counts, many = np.bincount(index, minlength=K**D), n * probs > 5
    assert stats.chisquare(counts[many], probs[many] / probs[many].sum() * counts[many].sum()).pvalue > 1e-3
    if bin_sample == "uniform":
        places = (action - LOW) / (HIGH - LOW) * K % 1
        assert all(stats.kstest(row, "uniform").pvalue > 1e-3 for row in places.T)


@pytest.mark.parametrize("rule", ["mode", "mean", "median"])
def test_without_exploration_each_dimension_follows_the_rule_after_the_ones_before(rule):
    params = params_of()
    found = policy_of(deterministic_action=rule).distribution(jnp.asarray(OUTPUTS, jnp.float32)[None], params)
    cell, action = np.zeros(D, int), np.zeros(D)
    for i in range(D):
        probs = np.exp(log_softmax(logits_of(OUTPUTS, params, cell))[i])
        centers = LOW[i] + (HIGH[i] - LOW[i]) * (np.arange(K) + 0.5) / K
        picked = probs.argmax() if rule == "mode" else (probs.cumsum() > 0.5).argmax()
        action[i] = probs @ centers if rule == "mean" else centers[picked]
        cell[i] = np.floor((action[i] - LOW[i]) / (HIGH[i] - LOW[i]) * K)
    np.testing.assert_allclose(found.deterministic_action()[0], action, rtol=1e-5, atol=1e-6)


@pytest.mark.parametrize("initial_policy", ["uniform", "gaussian"])
def test_at_its_start_it_is_the_softmax_policy_to_the_bit(initial_policy):
    words = {"n_bins": K, "initial_policy": initial_policy}
    ours, plain = policy_of(**words), HistogramPolicy(**words).on(BOX)
    first, params = ours.init()
    outputs = jnp.asarray(RNG.normal(size=(6, len(OUTPUTS))), jnp.float32) + first
    noise = plain.noise(jax.random.key(0), (6,))
    found, expected = ours.distribution(outputs, params), plain.distribution(outputs[:, : D * K], {})
    action = expected.sample(noise)
    np.testing.assert_array_equal(found.sample(noise), action)
    np.testing.assert_array_equal(found.given(action).logits, expected.logits)
    np.testing.assert_array_equal(found.log_prob(action), expected.log_prob(action))
    np.testing.assert_array_equal(found.deterministic_action(), expected.deterministic_action())
    np.testing.assert_array_equal(first[: D * K], plain.init()[0])
    np.testing.assert_allclose(found.entropy(), expected.entropy(), rtol=1e-6)
    np.testing.assert_allclose(found.std(), expected.std(), rtol=1e-5)


def with_logits(histogram, logits):
    return type(histogram)(histogram.bins, jnp.asarray(logits), histogram.choices)


@pytest.mark.usefixtures("double")
def test_the_mean_gradient_of_hl_one_hot_is_that_of_the_expected_reward():
    """Σ_a π(a) r(a) ∇ −log π(a) is −∇ Σ_a π(a) r(a), in all parameters; by the definition, without `given`."""
    policy, params, reward = policy_of(), params_of(), jnp.asarray(RNG.normal(size=len(CELLS)))
    action, start = jnp.asarray(CENTERS), (jnp.asarray(OUTPUTS), params)

    def of_all(start):
        outputs, params = start
        return policy.distribution(jnp.broadcast_to(outputs, (len(CELLS), len(OUTPUTS))), params)

    weight = jnp.exp(of_all(start).log_prob(action)) * reward
    found = jax.grad(lambda start: (weight * HLOneHot()(of_all(start).given(action), action)).sum())(start)

    def value(start):
        z, f = start[0][: D * K].reshape(D, K), start[0][D * K :]
        tables = [jax.nn.softmax(z[0])]
        for i in range(1, D):
            seen = f + sum(
                start[1]["embedding"][j].reshape(*[K if n == j else 1 for n in range(i)], M) for j in range(i)
            )
            tables.append(jax.nn.softmax(z[i] + jnp.tanh(seen) @ start[1]["readout"][i - 1]))
        joint = jnp.einsum("i,ij,ijk->ijk", *tables)
        return -(joint.ravel() * reward).sum()

    for ours, theirs in zip(jax.tree.leaves(found), jax.tree.leaves(jax.grad(value)(start)), strict=True):
        np.testing.assert_allclose(ours, theirs, rtol=1e-8, atol=1e-12)


@pytest.mark.usefixtures("double")
def test_centred_hl_gausss_gradient_in_the_conditional_logits_is_the_expected_target_less_the_targets():
    policy, params, eta = policy_of(), params_of(), 0.8
    outputs, action = jnp.broadcast_to(OUTPUTS, (len(CELLS), len(OUTPUTS))), jnp.asarray(CENTERS)
    mass = np.diff(stats.norm.cdf((np.arange(K + 1) - (np.arange(K)[:, None] + 0.5)) / eta))
    kernel = mass / mass.sum(1, keepdims=True)
    seen = policy.distribution(outputs, params).given(action)
    probs = np.exp(log_softmax(np.asarray(seen.logits)))

    def total(logits):
        return HLGaussCentred(eta=eta)(with_logits(seen, logits), action).sum()

    np.testing.assert_allclose(jax.grad(total)(seen.logits), probs @ kernel - kernel[CELLS], atol=1e-12)


def test_choices_are_softmaxes_beside_it_and_wide_targets_are_refused():
    box = Box((-1.0, 0.0, 0.0), (1.0, 2.0, 1.0), (0, 3, 0))
    agent = galton.make_agent(policy="autoregressive", loss="hl-one-hot", n_bins=K).on(box)
    first, params = agent.policy.init()
    outputs = jnp.asarray(RNG.normal(size=(4, len(first))), jnp.float32)
    params["readout"] = jnp.asarray(RNG.normal(size=params["readout"].shape), jnp.float32)
    found = agent.policy.distribution(outputs, params)
    action = found.sample(agent.policy.noise(jax.random.key(0), (4,)))
    seen = actor_critic.as_update_sees(agent, outputs, params, action)
    assert isinstance(seen, Mixed)
    np.testing.assert_allclose(agent.loss(seen, action), -found.log_prob(action), rtol=1e-5)
    with pytest.raises(galton.UsageError, match="policy is 'autoregressive' and loss 'hl-gauss', and some actions are"):
        galton.make_agent(policy="autoregressive", loss="hl-gauss", n_bins=K).on(box)


def test_the_features_keep_their_rate_beside_a_head_whose_rate_follows_the_width():
    ours = policy_of(head_rate="per-std")
    plain = HistogramPolicy(n_bins=K, head_rate="per-std").on(BOX)
    outputs = jnp.asarray(RNG.normal(size=(6, len(OUTPUTS))), jnp.float32)
    seen = plain.distribution(outputs[:, : D * K], {})
    np.testing.assert_array_equal(ours.head_rates(seen), [*plain.head_rates(seen), *np.ones(M)])


@pytest.mark.parametrize("loss", [HLOneHot(), HLGaussCentred(eta=1.0)])
def test_a_loss_may_stand_in_the_place_of_its_log_probability(loss):
    policy, params, action = policy_of(), params_of(), jnp.asarray(CENTERS[5], jnp.float32)

    def told(outputs):
        return as_log_prob(loss, policy.distribution(outputs, params), action)

    def given(outputs):
        return -loss(policy.distribution(outputs, params).given(action), action)

    outputs = jnp.asarray(OUTPUTS, jnp.float32)
    np.testing.assert_allclose(told(outputs), policy.distribution(outputs, params).log_prob(action), rtol=1e-6)
    np.testing.assert_allclose(jax.grad(told)(outputs), jax.grad(given)(outputs), rtol=1e-6)
