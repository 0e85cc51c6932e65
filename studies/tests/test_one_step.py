"""Each loss pulls the way that its gradient by hand says."""

import numpy as np
import pytest
from scipy.stats import norm

from galton.losses import LOSSES
from studies.paper import one_step
from studies.paper.one_step import ACTIONS, ADVANTAGES, BINS, FIGURE, STEP_SIZES

SOFTMAXES = [name for name, loss in LOSSES.items() if loss.family == "histogram"]
CENTERS = np.asarray(BINS.centers[0], np.float64)
SAMPLED = [int(np.abs(CENTERS - action).argmin()) for action in ACTIONS]


def changes(loss):
    """log π after − log π before, up to a constant: that of the logits."""
    return np.asarray(one_step.step(loss)["logits"] - one_step.start(loss)["logits"], np.float64)[0]


def test_the_sampled_actions_are_centers_of_bins_of_both_signs():
    np.testing.assert_array_equal(ACTIONS, BINS.centers[0, SAMPLED])
    assert min(ADVANTAGES) < 0 < max(ADVANTAGES)


def test_all_start_as_the_same_policy():
    x = CENTERS.astype(np.float32)
    np.testing.assert_allclose(one_step.density(one_step.policy(one_step.start("gaussian")), x), norm.pdf(x), rtol=1e-5)
    for loss in SOFTMAXES:
        density = one_step.density(one_step.policy(one_step.start(loss)), x)
        np.testing.assert_allclose(density, norm.pdf(x) / (norm.pdf(CENTERS).sum() * BINS.width), rtol=1e-4)


def test_the_gaussians_step_is_that_of_weighted_least_squares():
    """μ = 0 and σ = 1: ∂/∂μ of −A log π is −A a, ∂/∂log σ is −A (a² − 1)."""
    after = one_step.step("gaussian")
    a, advantage = ACTIONS.astype(np.float64), ADVANTAGES.astype(np.float64)
    np.testing.assert_allclose(after["mean"], [STEP_SIZES["gaussian"] * (advantage * a).mean()], rtol=1e-5)
    np.testing.assert_allclose(after["log_std"], [STEP_SIZES["gaussian"] * (advantage * (a**2 - 1)).mean()], rtol=1e-4)


def test_hl_1_hot_moves_the_sampled_bins_alone():
    """The logits' gradient is the mean of A (π − q), and ΣA = 0."""
    expected = np.zeros(BINS.n_bins)
    expected[SAMPLED] = STEP_SIZES["histogram"] * ADVANTAGES / len(ACTIONS)
    np.testing.assert_allclose(changes("hl-one-hot"), expected, atol=1e-6)
    before, after = (np.asarray(one_step.policy(f("hl-one-hot")).probs)[0] for f in (one_step.start, one_step.step))
    raised = [i for i, advantage in zip(SAMPLED, ADVANTAGES, strict=True) if advantage > 0]
    assert set(raised) <= set(np.flatnonzero(after > before))
    assert after[SAMPLED[0]] < before[SAMPLED[0]]
    proportions = np.delete(after / before, SAMPLED)
    np.testing.assert_allclose(proportions, proportions[0], rtol=1e-5)


@pytest.mark.parametrize("loss", ["hl-gauss", "hl-gauss-centred"])
def test_hl_gauss_shares_the_pull_with_the_neighbours(loss):
    change = changes(loss)
    for i, advantage in zip(SAMPLED, ADVANTAGES, strict=True):
        near, far = np.sign(advantage) * change[[i - 1, i + 1]], np.sign(advantage) * change[[0, -1]]
        assert (near > far).all()
    weights = norm.pdf(CENTERS[:, None], ACTIONS, one_step.ETAS[loss] * BINS.width[0])
    correlation = np.corrcoef(change, weights @ ADVANTAGES)[0, 1]
    assert correlation > 0.98


def test_centring_changes_nothing_here(monkeypatch):
    """As the caption says: with the same η it is the same step."""
    assert ADVANTAGES.sum() == pytest.approx(0, abs=1e-6)
    monkeypatch.setitem(one_step.ETAS, "hl-gauss", one_step.ETAS["hl-gauss-centred"])
    np.testing.assert_allclose(changes("hl-gauss"), changes("hl-gauss-centred"), atol=1e-5)


def test_the_figure_has_a_panel_per_loss_with_its_series_named():
    figure = FIGURE.draw(None)
    for axes, loss in zip(figure.axes, LOSSES, strict=True):
        gids = {artist.get_gid() for artist in axes.get_children()} - {None}
        assert gids == {"before the step", LOSSES[loss].label}
        up = [arrow.xy[1] > one_step._FLOOR for arrow in axes.texts if hasattr(arrow, "xy")]
        assert up == list(ADVANTAGES > 0)
    assert "(ours" in FIGURE.caption
