"""The softmax, ordinal and smoothed heads over any box: actions lie in it, and log π and entropy are float64's."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st
from scipy.special import log_softmax

from galton import UsageError

from ..agents import agent

D = 2
HEADS = ["histogram", "ordinal", "smoothed"]
ACTIONS = ["mode", "mean", "median"]


@pytest.mark.slow
@pytest.mark.parametrize("name", HEADS)
@settings(max_examples=30, deadline=None)
@given(
    st.floats(-1e3, 1e3),
    st.floats(1e-3, 1e4),
    st.sampled_from([2, 7, 41]),
    st.sampled_from(["inside", "bounds"]),
    st.floats(0, 30),
    st.integers(0, 999),
)
@example(6.0, 0.0078125, 2, "bounds", 6.0, 2)
def test_over_any_box(name, low, width, k, centers, scale, seed):
    low, high = (np.full(D, x, np.float32) for x in (low, low + width))
    words = {"loss": "hl-one-hot", "policy": name, "n_bins": k, "bin_centers": centers}
    try:
        policy = agent(words, low=low, high=high).policy
    except UsageError:  # the box is too narrow for so many bins in float32
        assert (high - low < 5e-7 * k * np.maximum(abs(low), abs(high))).all()
        return
    outputs = scale * jax.random.normal(jax.random.key(seed), (8, policy.n_outputs))
    found = policy.distribution(outputs, {})
    action = found.sample(policy.noise(jax.random.key(seed + 1), (8,)))
    for word in ACTIONS:
        at_rest = type(found)(found.bins, found.logits, found.choices._replace(deterministic_action=word))
        assert inside(at_rest.deterministic_action(), low, high)
    assert inside(action, low, high)

    log_probs = log_softmax(np.asarray(found.logits, np.float64), -1)
    index = np.abs(np.asarray(action)[..., None] - policy.bins.centers).argmin(-1)
    expected = np.take_along_axis(log_probs, index[..., None], -1)[..., 0].sum(-1)
    np.testing.assert_allclose(found.log_prob(action), expected, rtol=1e-5, atol=1e-5)
    entropy = -(np.exp(log_probs) * log_probs).sum((-2, -1))
    np.testing.assert_allclose(found.entropy(), entropy, atol=1e-5 * max(1, D * np.log(k)))


def inside(action, low, high):
    return bool(((jnp.asarray(action) >= low) & (jnp.asarray(action) <= high)).all())
