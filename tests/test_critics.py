"""Critics that classify: targets and values against torch and closed forms, gradients, and what is refused."""

import jax
import numpy as np
import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.stats import norm

from galton import A2C, UsageError, make_agent
from galton.critics import CRITICS
from galton_experiments.sweep import Setting

K, N = 21, 50
CENTERS = -3 + 10 * (np.arange(K) + 0.5) / K
CLASSIFIERS = ("hl-gauss", "two-hot")


def critic(name, **settings):
    return CRITICS[name](**{"n_value_bins": K, "value_min": -3.0, "value_max": 7.0} | settings)


@jax.jit
def told(critic, outputs, returns):
    """Values, losses and gradients of rows."""
    return critic.value(outputs), *jax.vmap(jax.value_and_grad(critic.loss))(outputs, returns)


def target(name, returns, **settings):
    """The weights that the gradient in the logits tells of, π − target, at uniform logits."""
    _, _, gradient = told(critic(name, **settings), np.zeros((N, K), np.float32), np.resize(np.float32(returns), N))
    return 1 / K - np.asarray(gradient, np.float64)[: len(returns)]


@pytest.mark.parametrize("name", CLASSIFIERS)
def test_values_and_losses_equal_torchs(name):
    rng = np.random.default_rng(0)
    logits, returns = rng.normal(size=(N, K)), rng.uniform(-2.5, 6.5, N)
    value = torch.softmax(torch.tensor(logits), -1) @ torch.tensor(CENTERS)
    found, loss, gradient = told(critic(name), np.float32(logits), np.float32(returns))
    np.testing.assert_allclose(found, value, rtol=1e-5, atol=1e-5)
    weights = torch.tensor(target(name, returns))
    entropy = torch.special.entr(weights.clamp_min(0)).sum(-1)
    given = torch.tensor(logits, requires_grad=True)
    expected = torch.nn.functional.cross_entropy(given, weights, reduction="none") - entropy
    np.testing.assert_allclose(loss, expected.detach().numpy(), rtol=1e-5, atol=1e-5)
    np.testing.assert_allclose(gradient, torch.autograd.grad(expected.sum(), given)[0].numpy(), atol=1e-5)


def test_two_hot_targets_mean_the_return():
    returns = np.linspace(CENTERS[0], CENTERS[-1], N)
    weights = target("two-hot", returns)
    np.testing.assert_allclose(weights @ CENTERS, returns, atol=1e-4)
    np.testing.assert_allclose(weights.sum(-1), 1, atol=1e-6)
    assert ((weights > 1e-5).sum(-1) <= 2).all()


@pytest.mark.parametrize("eta", [0.5, 0.75, 2.0])
def test_hl_gauss_targets_are_the_gaussians_masses(eta):
    """Cut off at the support, whose nearest center stands for a return beyond its ends."""
    inside = np.array([-1.3, 0.0, 2.22, 5.0])
    returns, edges = np.append(inside, [-2.9, 6.9, -50.0, 50.0]), np.linspace(-3, 7, K + 1)
    cdf = norm.cdf((edges - returns.clip(CENTERS[0], CENTERS[-1])[:, None]) / (eta * 10 / K))
    masses = np.diff(cdf) / (cdf[:, -1:] - cdf[:, :1])
    np.testing.assert_allclose(target("hl-gauss", returns, value_eta=eta), masses, atol=1e-6)
    np.testing.assert_allclose((masses @ CENTERS)[:4], inside, atol=5e-3 if eta < 2 else 0.1)


@pytest.mark.parametrize("name", CLASSIFIERS)
@settings(max_examples=50)
@given(st.floats(-1e6, 1e6), st.floats(1e-3, 1e6), st.sampled_from([2, 101]), st.floats(-1, 2))
def test_over_any_support(name, low, width, n, place):
    low, high = np.float32(low), np.float32(low + width)
    if not (high - low) > 1e-3 * max(abs(low), abs(high)):
        return
    one = critic(name, n_value_bins=n, value_min=low, value_max=high)
    centers = low + (high - low) * (np.arange(n) + 0.5) / n
    returns = np.float32([low + (high - low) * place, centers[0] if place < 0 else centers[-1]])
    value, loss, gradient = told(one, np.zeros((2, n), np.float32), returns)
    assert loss[0] >= -1e-5
    assert np.isfinite(gradient[0]).all()
    np.testing.assert_allclose(value, (low + high) / 2, rtol=1e-3, atol=1e-4 * (high - low))
    if not 0 <= place <= 1:
        np.testing.assert_allclose(gradient[0], gradient[1], atol=1e-3)


@pytest.mark.few
@pytest.mark.parametrize("name", CLASSIFIERS)
def test_a_return_outside_is_the_nearest_centers(name):
    returns = np.array([-1e6, -3.0, 7.0, 1e6])
    inside = np.array([CENTERS[0], CENTERS[0], CENTERS[-1], CENTERS[-1]])
    np.testing.assert_allclose(target(name, returns), target(name, inside), atol=1e-5)


@pytest.mark.parametrize(
    ("given", "said"),
    [
        ({"critic": "hl_gauss"}, ["critic is 'hl_gauss'", "did you mean hl-gauss?"]),
        ({"critic": "hl-gauss"}, ["set normalize_reward, or value_min"]),
        ({"critic": "two-hot", "value_min": 2.0, "value_max": 1.0}, ["value_min is 2.0", "value_max 1.0"]),
        ({"critic": "two-hot", "normalize_reward": True, "value_eta": 1.0}, ["value_eta is 1.0", "'hl-gauss'"]),
        ({"n_value_bins": 51}, ["n_value_bins is 51", "critic 'hl-gauss'", "not 'squared-error'"]),
        ({"critic": "hl-gauss", "n_value_bins": 1}, ["n_value_bins is 1"]),
    ],
)
def test_what_does_not_fit_is_refused(given, said):
    for attempt in (
        lambda: make_agent(**given),
        lambda: A2C("lqr", preset="paper", **given),
        lambda: Setting(given),
    ):
        with pytest.raises(UsageError) as error:
            attempt()
        for words in said:
            assert words in str(error.value)
