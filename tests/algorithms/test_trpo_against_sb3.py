"""Our TRPO against sb3-contrib's (torch), from equal weights, on a recorded rollout, in the same minibatches."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
import sb3_contrib
import torch

from galton import make_agent
from galton.algorithms import actor_critic
from galton.parts import Box

from .sb3_side import HIGH, LOW, K, Recorder, params_of, record_batch, relative_error, vector_of

T, N, SIZE, PASSES = 64, 2, 32, 10
SAME = {
    "n_steps": T,
    "gamma": 0.97,
    "gae_lambda": 0.9,
    "learning_rate": 2e-3,
    "cg_damping": 0.05,
    "cg_max_steps": 12,
    "line_search_max_iter": 7,
    "line_search_shrinking_factor": 0.6,
}
"""What both have by the same names."""


def sb3_side(monkeypatch, loss, **words):
    """sb3-contrib's TRPO and the permutations that it draws; its conjugate gradients begin at 0, as ours do."""
    envs, orders, shuffle = [Recorder(loss != "gaussian") for _ in range(N)], [], np.random.permutation
    own = {"batch_size": SIZE, "n_critic_updates": PASSES, "seed": 3, "device": "cpu"}
    model = sb3_contrib.TRPO("MlpPolicy", vector_of(envs), **SAME, **own, **words)
    model._setup_learn(10_000, None)
    monkeypatch.setattr(torch, "randn_like", torch.zeros_like)
    monkeypatch.setattr(np.random, "permutation", lambda n: orders.append(shuffle(n)) or orders[-1])
    return model, envs, orders


@pytest.mark.parametrize("loss", ["gaussian", "hl-one-hot"])
@pytest.mark.parametrize(
    ("max_kl", "normalize_advantage"), [(0.01, True), pytest.param(0.3, False, marks=pytest.mark.slow)]
)
def test_the_policys_step_and_the_critics_equal_sb3s(monkeypatch, loss, max_kl, normalize_advantage, trust):
    words = {"normalize_advantage": normalize_advantage}
    model, envs, orders = sb3_side(monkeypatch, loss, target_kl=max_kl, **words)
    start = params_of(model)
    batch = record_batch(model, envs, loss != "gaussian")
    orders.clear()
    model.train()
    told = model.logger.name_to_value
    assert told["train/is_line_search_success"]

    # SB3's divergence of a Gaussian is the mean over the dimensions, not their sum: ours has other units.
    units = len(LOW) if loss == "gaussian" else 1
    own = {"n_envs": N, "n_bins": K, "batch_size": SIZE, "n_critic_updates": PASSES, "max_kl": units * max_kl}
    settings = SAME | own | words | {"cg_damping": units * SAME["cg_damping"]}
    agent = make_agent(algorithm="trpo", loss=loss, **settings).on(Box.of(LOW, HIGH))
    learner = actor_critic.init(jax.random.key(0), agent, 3)._replace(params=jax.tree.map(jnp.asarray, start))
    _, *rows = np.array(orders)  # the first is that of the policy's step, which sees all rows at once
    rows = jnp.asarray(np.array(rows) % T * N + np.array(rows) // T)
    after, ours = jax.jit(agent.algorithm.fit)(agent, learner, batch, rows)

    moved = [jax.tree.map(np.subtract, end, start) for end in (after.params, params_of(model))]
    apart = relative_error(*moved)
    assert apart < 1e-4
    assert all(np.abs(leaf).max() > 1e-4 for leaf in jax.tree.leaves(moved[1]))
    assert 0.1 * max_kl < ours["kl"] / units < max_kl
    np.testing.assert_allclose(ours["value_loss"], told["train/value_loss"], rtol=1e-4)
    # That is KL(π ‖ π_old) there and KL(π_old ‖ π) here, as in the paper; they differ in the third order of the step.
    old, new = (actor_critic.distribution(agent, one.params, batch.observation) for one in (learner, after))
    np.testing.assert_allclose(old.kl(new).mean(), ours["kl"], rtol=1e-4)
    np.testing.assert_allclose(new.kl(old).mean() / units, told["train/kl_divergence_loss"], rtol=1e-3)
    promise = "A step of TRPO moves the weights as sb3-contrib's does."
    trust("trpo-and-sb3", promise, topic="numbers", figure=apart, unit="apart, relative to the change", at_most=1e-4)
