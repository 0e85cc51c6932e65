"""Both ratios of PPO against numpy, in float64, from the logits before and after a change."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.special import log_softmax

from galton.networks import mlp

from .minibatches import N, T, agent_of, fit, moved, prepare, rollout_of


@pytest.mark.few
@pytest.mark.parametrize("ratio", ["smoothed", "true"])
def test_a_ratio_is_numpys(ratio):
    agent = agent_of("auto", "hl-gauss", ratio=ratio, batch_size=T * N)
    before = moved(agent)
    rows = prepare(agent, before, rollout_of(agent, before))
    params = before.params | {"actor": jax.tree.map(lambda x: 1.1 * x, before.params["actor"])}
    _, told = fit(agent, before._replace(params=params), rows, jnp.arange(T * N)[None])
    logits = [np.asarray(mlp(one["actor"], rows.observation), np.float64) for one in (before.params, params)]
    shape = (T * N, rows.action.shape[-1], agent.policy.n_bins)
    change = np.subtract(*(log_softmax(x.reshape(shape), -1) for x in logits[::-1]))
    distribution = agent.policy.distribution(mlp(before.params["actor"], rows.observation), before.params)
    targets = agent.loss.target(distribution, rows.action) if ratio == "smoothed" else None
    if targets is None:  # all of it in the bin of the action
        place = (np.asarray(rows.action) - agent.low) / (np.asarray(agent.high) - agent.low) * agent.policy.n_bins
        targets = np.eye(agent.policy.n_bins)[place.astype(int)]
    expected = np.exp((np.asarray(targets, np.float64) * change).sum((-1, -2)))
    assert expected.max() > 1.05
    np.testing.assert_allclose([told["ratio_mean"], told["ratio_max"]], [expected.mean(), expected.max()], rtol=1e-5)
