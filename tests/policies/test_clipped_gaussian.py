"""What the clipped-action policy gradient promises: the Gaussian's mean gradient with less variance. In float64."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from galton.policies import ClippedGaussian, Gaussian, SquashedGaussian

pytestmark = pytest.mark.usefixtures("double")

LOW, HIGH = np.array([-1.0]), np.array([1.5])
Z = np.linspace(-8, 8, 40_001)
WEIGHT = np.exp(-0.5 * Z**2) / np.exp(-0.5 * Z**2).sum()


def gradients(make, mean, log_std, action):
    """∇ log π of each action in (mean, log σ), `[n, 2]`."""

    def log_prob(given, action):
        return make(Gaussian(given[:1], given[1:], LOW, HIGH)).log_prob(action)

    return jax.jit(jax.vmap(jax.grad(log_prob), (None, 0)))(jnp.array([mean, log_std]), jnp.asarray(action)[:, None])


@pytest.mark.parametrize(("mean", "log_std"), [(0.7, -0.2), (-2.0, 0.3), (0.0, 1.0)])
def test_it_has_the_gaussians_mean_gradient_and_less_variance(mean, log_std):
    action = mean + np.exp(log_std) * Z
    earned = np.sin(3 * np.clip(action, LOW, HIGH)) + 0.5
    plain, clipped = (
        earned[:, None] * np.asarray(gradients(make, mean, log_std, action)) for make in (lambda x: x, ClippedGaussian)
    )
    first = [WEIGHT @ one for one in (plain, clipped)]
    np.testing.assert_allclose(first[1], first[0], atol=1e-3)
    spread = [WEIGHT @ (one - mean) ** 2 for one, mean in zip((plain, clipped), first, strict=True)]
    assert (spread[1] < 0.99 * spread[0]).all()


@pytest.mark.parametrize(("mean", "log_std"), [(0.7, -0.2), (9.0, 0.3), (-6.0, 1.0)])
def test_the_squashed_gaussians_score_is_zero_on_average_even_where_tanh_is_saturated(mean, log_std):
    with jax.enable_x64(False):
        low, high = np.float32(LOW), np.float32(HIGH)

        def log_prob(given, noise):
            distribution = SquashedGaussian(given[:1], given[1:], low, high)
            return distribution.log_prob(jax.lax.stop_gradient(distribution.sample(noise[None])))

        score = jax.jit(jax.vmap(jax.grad(log_prob), (None, 0)))
        found = np.asarray(score(jnp.array([mean, log_std], jnp.float32), jnp.asarray(Z, jnp.float32)), np.float64)
    assert (abs(found) > 0.1).any()
    np.testing.assert_allclose(WEIGHT @ found, 0, atol=0.03)
