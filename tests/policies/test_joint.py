"""One softmax over a grid, beside an enumeration of its cells, and its losses' gradients beside numpy's matrices."""

import functools

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy import stats

import galton
from galton import UsageError
from galton.losses import HLGauss, HLGaussCentred, HLOneHot
from galton.parts import Box
from galton.policies import HistogramPolicy, JointPolicy

LOW, HIGH = np.array([-1.0, 0.0, -2.0]), np.array([1.0, 3.0, 1.0])
RNG = np.random.default_rng(0)


def policy_of(d, k, **words):
    return JointPolicy(n_bins=k, **words).on(Box.of(LOW[:d], HIGH[:d]))


def centers_of(d, k):
    """The centers of all cells, `[k^d, d]`, the last dimension counting fastest."""
    axes = [low + (high - low) * (np.arange(k) + 0.5) / k for low, high in zip(LOW[:d], HIGH[:d], strict=True)]
    return np.stack(np.meshgrid(*axes, indexing="ij"), -1).reshape(-1, d)


def softmax(x):
    weights = np.exp(x - x.max(-1, keepdims=True))
    return weights / weights.sum(-1, keepdims=True)


@pytest.mark.parametrize(("d", "k"), [(1, 5), (2, 4), (3, 3)])
def test_probabilities_moments_and_actions_are_those_of_an_enumeration(d, k):
    policy, centers = policy_of(d, k), centers_of(d, k)
    logits = RNG.normal(size=(2, k**d)).astype(np.float32)
    probs = softmax(logits.astype(np.float64))
    found = policy.distribution(jnp.asarray(logits), {})
    of_cells = jnp.broadcast_to(jnp.asarray(centers, jnp.float32)[:, None], (k**d, 2, d))
    np.testing.assert_allclose(np.exp(jax.vmap(found.log_prob)(of_cells)).T, probs, rtol=1e-5)
    np.testing.assert_allclose(np.exp(jax.vmap(found.log_prob_of_bins)(of_cells)).sum(0), 1, rtol=1e-5)
    np.testing.assert_allclose(found.entropy(), -(probs * np.log(probs)).sum(-1), rtol=1e-5)
    mean = probs @ centers
    np.testing.assert_allclose(found.std(), np.sqrt(probs @ centers**2 - mean**2), rtol=1e-4)
    np.testing.assert_allclose(found.deterministic_action(), centers[logits.argmax(-1)], rtol=1e-5, atol=1e-6)
    by_mean = policy.acting_by("mean").distribution(jnp.asarray(logits), {})
    np.testing.assert_allclose(by_mean.deterministic_action(), mean, rtol=1e-4, atol=1e-5)


@pytest.mark.parametrize("bin_sample", ["center", "uniform"])
@pytest.mark.parametrize("bin_centers", ["inside", "bounds"])
def test_cells_are_drawn_as_often_as_they_are_likely(bin_centers, bin_sample):
    policy, n = policy_of(2, 4, bin_centers=bin_centers, bin_sample=bin_sample), 20_000
    logits = RNG.normal(size=16).astype(np.float32)
    found = policy.distribution(jnp.broadcast_to(logits, (n, 16)), {})
    action = np.asarray(found.sample(policy.noise(jax.random.key(1), (n,))))
    rows = [np.searchsorted(edges[1:-1], a, "right") for edges, a in zip(found.bins.edges, action.T, strict=True)]
    counts = np.bincount(rows[0] * 4 + rows[1], minlength=16)
    assert stats.chisquare(counts, n * softmax(logits.astype(np.float64))).pvalue > 1e-3
    assert len(np.unique(action, axis=0)) == 16 or bin_sample == "uniform"
    if bin_sample == "uniform":
        for edges, row, a in zip(found.bins.edges, rows, action.T, strict=True):
            assert stats.kstest((a - edges[row]) / (edges[row + 1] - edges[row]), "uniform").pvalue > 1e-3


def kernel_of(k, eta):
    """Row j: the Gaussian around bin j's center, cut off at the box and rescaled, in units of bins."""
    mass = np.diff(stats.norm.cdf((np.arange(k + 1) - (np.arange(k)[:, None] + 0.5)) / eta))
    return mass / mass.sum(1, keepdims=True)


@pytest.mark.parametrize("d", [2, 3])
@pytest.mark.parametrize("rule", ["fixed", "policy"])
def test_targets_are_products_and_gradients_those_of_kronecker_products(d, rule):
    """HL-1-Hot's is π − 1_a, HL-Gauss's π − K_a and the centred one's Kᵀπ − K_a with K = K_1 ⊗ … ⊗ K_d."""
    k, n = 4, 3
    with jax.enable_x64(True):
        policy, centers = policy_of(d, k), centers_of(d, k)
        logits, cells = RNG.normal(size=(n, k**d)), RNG.integers(k**d, size=n)
        probs, action = softmax(logits), jnp.asarray(centers[cells])
        width = (HIGH - LOW)[:d] / k
        std = np.sqrt(probs @ centers**2 - (probs @ centers) ** 2)
        etas = np.full((n, d), 0.8) if rule == "fixed" else np.clip(0.8 * std / width, 0.5, 16)
        whole = [functools.reduce(np.kron, [kernel_of(k, eta) for eta in row]) for row in etas]
        target = np.array([matrix[cell] for matrix, cell in zip(whole, cells, strict=True)])
        expected = np.einsum("bji,bj->bi", whole, probs)

        def gradient(loss):
            return jax.grad(lambda x: loss(policy.distribution(x, {}), action).sum())(jnp.asarray(logits))

        words = {"eta": 0.8, "eta_rule": rule}
        wide = HLGauss(**words).target(policy.distribution(jnp.asarray(logits), {}), action)
        np.testing.assert_allclose(wide[:, 0], target, atol=1e-12)
        np.testing.assert_allclose(gradient(HLOneHot()), probs - np.eye(k**d)[cells], atol=1e-12)
        np.testing.assert_allclose(gradient(HLGauss(**words)), probs - target, atol=1e-12)
        np.testing.assert_allclose(gradient(HLGaussCentred(**words)), expected - target, atol=1e-12)


def test_an_action_that_is_no_center_has_the_product_of_its_own_targets():
    joint, plain = (
        kind(n_bins=5, bin_sample="uniform").on(Box.of(LOW, HIGH)) for kind in (JointPolicy, HistogramPolicy)
    )
    action = jnp.asarray(RNG.uniform(LOW, HIGH, (4, 3)), jnp.float32)
    loss = HLGauss(eta=1.5, target_tails="edges")
    rows = np.asarray(loss.target(plain.distribution(jnp.zeros((4, 15)), {}), action))
    cells = np.einsum("bi,bj,bk->bijk", *np.moveaxis(rows, 1, 0)).reshape(4, 1, -1)
    np.testing.assert_allclose(loss.target(joint.distribution(jnp.zeros((4, 125)), {}), action), cells, rtol=1e-5)


@pytest.mark.parametrize("initial_policy", ["uniform", "gaussian", "clipped-gaussian"])
def test_it_starts_as_the_product_of_the_softmax_policys_dimensions(initial_policy):
    words = {"n_bins": 6, "initial_policy": initial_policy, "log_std_init": -0.4, "box_units": 1.0}
    joint, plain = (kind(**words).on(Box.of(LOW, HIGH)) for kind in (JointPolicy, HistogramPolicy))
    ours, theirs = (policy.distribution(*policy.init()) for policy in (joint, plain))
    rows = np.asarray(theirs.probs)
    np.testing.assert_allclose(ours.probs[0], np.einsum("i,j,k->ijk", *rows).ravel(), rtol=2e-5)
    assert joint.uniform_entropy == plain.uniform_entropy


@pytest.mark.parametrize(
    ("d", "words", "told"),
    [
        (4, {"n_bins": 5}, "policy is 'joint', and actions have 4 dimensions; it takes at most 3"),
        (3, {"n_bins": 28}, "n_bins is 28, which makes 21952 cells in 3 dimensions; .* make n_bins 27 or less"),
        (2, {"deterministic_action": "median"}, "deterministic_action is 'median'; choose from mode, mean"),
    ],
)
def test_what_a_grid_cannot_be_is_refused_by_name(d, words, told):
    with pytest.raises(UsageError, match=told):
        galton.make_agent(policy="joint", loss="hl-one-hot", **words).on(Box((0.0,) * d, (1.0,) * d))
