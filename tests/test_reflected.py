"""The reflected kernel against its closed form in float64, and what it makes of centred HL-Gauss's step (P1, P2)."""

import jax
import numpy as np
import pytest
import scipy.fft
import scipy.stats

from galton import targets
from galton.bins import Bins
from galton.losses import HLGauss, HLGaussCentred
from galton.policies.histogram import Histogram
from galton.policies.smoothed import SmoothedPolicy

pytestmark = pytest.mark.usefixtures("double")

SIZES = [(2, 0.3), (10, 0.25), (10, 2.0), (50, 4.48), (100, 20.0), (12, 4.0), (12, 4.001), (10, 20.0), (41, 33.0)]


def kernel(k, eta, tails="reflected", centers="inside"):
    return np.asarray(targets.hl_gauss_of_center(k, np.arange(k), eta, tails, centers))


def by_definition(k, eta):
    """Each bin's Gaussian, cut at all edges as far as it reaches, and what lies beyond folded back."""
    reach = k * round(6 + 9 * eta / k)
    edges = np.arange(-reach, reach + 1)
    found = np.zeros((k, k))
    for j in range(k):
        mass = np.diff(scipy.stats.norm.cdf(edges, j + 0.5, eta))
        for bin_, share in zip(edges[:-1], mass, strict=True):
            place = bin_ % (2 * k)
            found[j, place if place < k else 2 * k - 1 - place] += share
    return found


@pytest.mark.parametrize(("k", "eta"), SIZES)
def test_it_is_the_gaussian_folded_at_the_ends(k, eta):
    found = kernel(k, eta)
    np.testing.assert_allclose(found, by_definition(k, eta), atol=1e-12)
    np.testing.assert_allclose(found, found.T, atol=1e-15)
    np.testing.assert_allclose(found.sum(0), 1, rtol=1e-12)
    assert np.linalg.eigvalsh(found).min() > -1e-14


@pytest.mark.parametrize(("k", "eta"), [(2, 4.48), (7, 10.0), (41, 100.0)])
def test_however_wide_it_is_its_rows_sum_to_one(k, eta):
    found = kernel(k, eta)
    np.testing.assert_allclose(found.sum(0), 1, rtol=1e-12)
    np.testing.assert_allclose(found.sum(1), 1, rtol=1e-12)


def test_it_is_diagonal_in_the_cosine_transform():
    k, eta = 50, 4.48
    waves = scipy.fft.dct(np.eye(k), type=2, norm="ortho", axis=0)
    m = np.arange(k)
    of_bins = np.sinc(m / (2 * k))  # a bin's mass is an average over its width
    expected = np.diag(np.exp(-((np.pi * m * eta / k) ** 2) / 2) * of_bins)
    np.testing.assert_allclose(waves @ kernel(k, eta) @ waves.T, expected, atol=1e-14)


@pytest.mark.parametrize("centers", ["inside", "bounds"])
def test_the_target_of_a_center_is_its_row_and_of_any_action_its_own(centers):
    bins = Bins(np.array([-1.0]), np.array([3.0]), 12, centers)
    at_centers = targets.hl_gauss(bins, np.asarray(bins.centers).T, 1.7, "reflected")[:, 0]
    np.testing.assert_allclose(at_centers, kernel(12, 1.7), atol=1e-6)  # bins are in float32
    widths = np.full(12, 1.7)
    np.testing.assert_allclose(
        targets.hl_gauss_of_center(12, np.arange(12), widths, "reflected"), kernel(12, 1.7), atol=1e-14
    )


@pytest.mark.parametrize("k", [10, targets.FEW + 1])
@pytest.mark.parametrize("each", [False, True])
def test_the_expected_target_is_the_matrix_product(k, each):
    probs = np.random.default_rng(0).dirichlet(np.ones(k), 3)
    widths = np.array([0.5, 2.0, 7.0])
    found = targets.mean_of_centers(probs, widths if each else 2.0, "reflected")
    for row, of, eta in zip(found, probs, widths, strict=True):
        np.testing.assert_allclose(row, of @ kernel(k, eta if each else 2.0), atol=1e-13)


def steps(k, eta, tails, advantages, logits):
    """The mean step of centred HL-Gauss along the logits, and the exact policy gradient F A; for each row."""
    probs = scipy.special.softmax(logits, -1)
    of_rows = kernel(k, eta, tails)
    fisher = np.einsum("ni,ij->nij", probs, np.eye(k)) - np.einsum("ni,nj->nij", probs, probs)
    exact = np.einsum("nij,nj->ni", fisher, advantages)
    return (
        np.einsum("nji,nj->ni", of_rows[None] - (probs @ of_rows)[:, None], probs * advantages),
        exact @ of_rows,
        exact,
    )


def test_the_mean_step_is_the_policy_gradient_smoothed_and_ascends_for_every_advantage():
    """E[A (K_a − Kᵀπ)] = Kᵀ F A by the loss's own gradient, and its product with F A is never negative."""
    k, eta, rng = 12, 2.0, np.random.default_rng(1)
    bins = Bins(np.array([-1.0]), np.array([1.0]), k)
    logits, advantages = rng.normal(size=(40, k)) * 2, rng.normal(size=(40, k)) ** 3
    step, smoothed, exact = steps(k, eta, "reflected", advantages, logits)
    np.testing.assert_allclose(step, smoothed, atol=1e-12)
    assert (np.einsum("ni,ni->n", exact, step) > -1e-12).all()

    loss, actions = HLGaussCentred(eta=eta, target_tails="reflected"), np.asarray(bins.centers).T

    def mean_loss(row, advantage):
        each = loss(Histogram(bins, row[None, None]), actions)
        return (jax.nn.softmax(jax.lax.stop_gradient(row)) * advantage * each).sum()

    np.testing.assert_allclose(-jax.grad(mean_loss)(logits[0], advantages[0]), smoothed[0], atol=1e-12)


def test_with_edges_some_advantage_makes_the_mean_step_descend():
    """(K + Kᵀ)/2 has the eigenvalue −.049 across the constants: at a uniform policy that direction is an advantage."""
    k, eta = 50, 4.48
    for tails, least in (("edges", -0.049), ("reflected", 0.0)):
        of_rows = kernel(k, eta, tails)
        flat = np.eye(k) - 1 / k
        values, vectors = np.linalg.eigh(flat @ (of_rows + of_rows.T) @ flat / 2)
        assert values[0] == pytest.approx(least, abs=5e-4)
        step, _, exact = steps(k, eta, tails, vectors[:, :1].T, np.zeros((1, k)))
        assert (exact @ step.T < -1e-6) == (tails == "edges")


def test_it_does_not_pull_on_a_uniform_policy():
    uniform = Histogram(Bins(np.array([-1.0]), np.array([1.0]), 20), np.zeros((1, 1, 20)))
    pulls = {
        tails: np.abs(HLGauss(eta=3.0, target_tails=tails).bias(uniform)).max()
        for tails in ("reflected", "rescaled", "edges")
    }
    assert pulls["reflected"] < 1e-15
    assert min(pulls["rescaled"], pulls["edges"]) > 1e-3


def test_the_smoothed_softmax_has_it_too():
    policy = SmoothedPolicy(n_bins=10, eta=2.0, target_tails="reflected")
    np.testing.assert_allclose(policy.kernel(), kernel(10, 2.0), atol=1e-15)
