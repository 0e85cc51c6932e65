"""Our updates against those of Stable-Baselines3's A2C (torch, Adam), from equal weights and recorded batches."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
import stable_baselines3

from galton.algorithms import actor_critic
from galton.torch.sb3 import HistogramPolicy

from ..agents import agent as agent_on
from .sb3_side import HIGH, LOW, K, Recorder, params_of, record_batch, relative_error, vector_of

T, N = 10, 2
SAME = {
    "n_steps": T,
    "learning_rate": 1e-3,
    "gamma": 0.97,
    "gae_lambda": 0.9,
    "vf_coef": 0.4,
    "ent_coef": 0.01,
    "max_grad_norm": 0.5,
}
"""What both have by the same names."""
WORDS = {"n_bins": K, "n_envs": N, **SAME}


def sb3_model(discrete, normalize_advantage, of_ours=None):
    envs = [Recorder(discrete) for _ in range(N)]
    model = stable_baselines3.A2C(
        HistogramPolicy if of_ours else "MlpPolicy",
        vector_of(envs),
        **SAME,
        use_rms_prop=False,
        normalize_advantage=normalize_advantage,
        policy_kwargs=of_ours,
        seed=3,
        device="cpu",
    )
    model._setup_learn(10_000, None)
    return model, envs


@pytest.mark.parametrize(
    ("loss", "normalize_advantage"),
    [
        pytest.param("gaussian", False, marks=pytest.mark.slow),
        ("gaussian", True),
        ("hl-one-hot", False),
        pytest.param("hl-one-hot", True, marks=pytest.mark.optimised),
    ],
)
def test_updates_equal_sb3s(loss, normalize_advantage, trust):
    apart = check_updates(loss, normalize_advantage)
    promise = "Twenty updates of A2C are Stable-Baselines3's, from the same weights on the same steps."
    trust("a2c-and-sb3", promise, topic="numbers", figure=apart, unit="apart, relative to all weights", at_most=1e-3)


@pytest.mark.parametrize(
    ("loss", "words"),
    [
        ("hl-gauss-centred", {"eta": 2.0, "bin_centers": "bounds", "target_tails": "reflected"}),
        ("hl-gauss", {"eta": 0.25, "bin_centers": "inside", "target_tails": "rescaled", "head_scale": 4.0}),
        pytest.param("hl-one-hot", {"bin_centers": "bounds"}, marks=pytest.mark.slow),
    ],
)
def test_sb3s_a2c_with_the_distribution_in_torch_is_galtons(loss, words):
    check_updates(loss, False, words)


def check_updates(loss, normalize_advantage, of_ours=None):
    """Hold 20 updates against SB3's, which has the distribution in torch where it gets settings of bins."""
    discrete = loss == "hl-one-hot" and of_ours is None
    in_sb3 = None if of_ours is None else of_ours | {"n_bins": K, "loss": loss}
    model, envs = sb3_model(discrete, normalize_advantage, in_sb3)
    words = WORDS | {"loss": loss, "normalize_advantage": normalize_advantage} | (of_ours or {})
    agent = agent_on(words, low=LOW, high=HIGH)
    start = jax.tree.map(jnp.asarray, params_of(model))
    learner = actor_critic.init(jax.random.key(0), agent, 3)._replace(params=start)
    update = jax.jit(lambda learner, batch: agent.algorithm.update(agent, learner, batch, jax.random.key(1))[0])

    for i in range(20):
        batch = record_batch(model, envs, discrete)
        assert batch.terminated.any()
        assert batch.truncated.any()
        model.train()
        learner = update(learner, batch)
        if i == 0:
            theirs = params_of(model)
            change = jax.tree.map(np.subtract, theirs, start)
            assert all(np.abs(leaf).max() > 1e-4 for leaf in jax.tree.leaves(change))
            # An entry may be off by a ten-thousandth of Adam's step: where a gradient is near Adam's ε, rounding shows.
            jax.tree.map(lambda a, b: np.testing.assert_allclose(a, b, rtol=1e-5, atol=1e-7), learner.params, theirs)
    apart = relative_error(learner.params, params_of(model))
    assert apart < 1e-3
    return apart
