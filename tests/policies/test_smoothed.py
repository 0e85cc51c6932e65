"""The smoothed softmax: a moving average of outputs, whose gradient is centred HL-Gauss's."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from galton import targets
from galton.losses import HLGaussCentred, HLOneHot
from galton.parts import Box
from galton.policies import HistogramPolicy, SmoothedPolicy

LOW, HIGH, K = np.array([-1.0, 0.0]), np.array([1.0, 5.0]), 9
STARTS = [("uniform", "bounds"), ("gaussian", "inside"), ("clipped-gaussian", "bounds")]


def policies(eta=0.25, tails="rescaled", **fields):
    """The smoothed and the plain one with the same settings otherwise."""
    smoothed = SmoothedPolicy(n_bins=K, eta=eta, target_tails=tails, **fields)
    return [policy.on(Box.of(LOW, HIGH)) for policy in (smoothed, HistogramPolicy(n_bins=K, **fields))]


@pytest.mark.parametrize(("eta", "tails"), [(0.3, "rescaled"), (4.0, "edges")])
def test_logits_are_moving_averages_of_the_outputs(eta, tails):
    smoothed, plain = policies(eta, tails)
    outputs = np.random.default_rng(0).normal(size=(4, 2 * K)).astype(np.float32)

    @jax.jit
    def tell(outputs):
        kernel = targets.hl_gauss(plain.bins, jnp.asarray(plain.bins.centers.T), eta, tails)[:, 0]
        found, raised = (smoothed.distribution(outputs + up, {}) for up in (0.0, 3.0))
        return kernel, found.logits, found.probs, raised.probs

    kernel, logits, probs, raised = tell(outputs)
    np.testing.assert_allclose(kernel.sum(1), 1, rtol=1e-5)
    np.testing.assert_allclose(logits, np.einsum("ij,bdj->bdi", kernel, outputs.reshape(4, 2, K)), atol=1e-5)
    np.testing.assert_allclose(raised, probs, rtol=1e-4, atol=1e-6)


@pytest.mark.slow
def test_hl_one_hots_gradient_in_the_outputs_is_centred_hl_gausss_in_the_logits():
    with jax.enable_x64(True):
        smoothed, plain = policies(eta=2.0)
        outputs = jax.random.normal(jax.random.key(1), (5, 2 * K))
        ours = smoothed.distribution(outputs, {})
        action = ours.sample(smoothed.noise(jax.random.key(2), (5,)))

        def total(loss, policy, outputs):
            return loss(policy.distribution(outputs, {}), action).sum()

        found = jax.jit(jax.grad(lambda z: total(HLOneHot(), smoothed, z)))(outputs)
        expected = jax.jit(jax.grad(lambda x: total(HLGaussCentred(eta=2.0), plain, x)))(ours.logits.reshape(5, -1))
        np.testing.assert_allclose(found, expected, atol=1e-10)
        assert float(jnp.abs(found).max()) > 1e-2


@pytest.mark.few
@pytest.mark.parametrize(("initial_policy", "bin_centers"), STARTS)
def test_it_starts_exactly_as_the_softmax_policy(initial_policy, bin_centers):
    both = policies(2.0, initial_policy=initial_policy, bin_centers=bin_centers, log_std_init=-0.5)
    starts = jax.jit(lambda: [policy.distribution(policy.init()[0], {}).probs for policy in both])()
    np.testing.assert_allclose(*starts, rtol=1e-5, atol=1e-8)


def test_with_a_narrow_kernel_it_is_the_softmax_policy():
    outputs = jax.random.normal(jax.random.key(3), (4, 2 * K))
    found, expected = (policy.distribution(outputs, {}).logits for policy in policies(eta=0.05))
    np.testing.assert_allclose(found, expected, atol=1e-5)
